//! Synthetic figures: those of a study of four arms on five levels, and cases at the edge.

use chacha20::ChaCha8Rng;
use charts::{
    About, Axis, Curve, CurveChart, CurvePanel, Drawing, Estimate, GridMap, GridMaps, HeatMap, HeatPanel,
    IntervalChart, IntervalPanel, IntervalSeries, Layout, Orientation, Reference, Segment, Stage, Style, Tile, Width,
};
use rand::{RngExt, SeedableRng};

/// A figure with its file's name.
pub struct Example {
    pub name: &'static str,
    pub caption: &'static str,
    pub drawing: Drawing,
    /// Whether it shows a case at the edge rather than one of the study's figures.
    pub edge: bool,
}

pub const ARMS: [&str; 4] = ["PPO", "PPO with L2", "PPO-ε", "DQN"];
const LEVELS: usize = 5;
const STAGE: f64 = 500_000.0;
const NUM_SEEDS: usize = 10;
const OPTIMA: [f64; LEVELS] = [45.0, 41.0, 36.0, 30.0, 33.0];
const A_STAR: [f64; LEVELS] = [42.0, 35.0, 29.0, 12.0, 21.0];

pub fn all() -> Vec<Example> {
    let study = |name, caption, drawing| Example { name, caption, drawing, edge: false };
    let edge = |name, caption, drawing| Example { name, caption, drawing, edge: true };
    vec![
        study("maps", "The five levels.", maps()),
        study("curriculum", "Return over the curriculum: mean, 95% interval and single seeds.", curriculum(&ARMS[..2])),
        study("curriculum-wide", "The same across the page, all arms.", wide_curriculum()),
        study("from-scratch", "Curriculum against training from scratch, level by level.", from_scratch()),
        study("plasticity", "Measures of plasticity.", plasticity()),
        study("final-returns", "Average return of each arm on each level.", final_returns()),
        study("continual", "Continual-learning measures.", continual()),
        study("improvement", "Probability that the first is better than the second.", improvement()),
        study("matrix", "Return on level j after stage i.", matrix()),
        study("forgetting", "Change since the level was learned, for all arms.", forgetting()),
        edge("one-seed", "One seed: no band. Its measurements break off twice.", one_seed()),
        edge("empty", "No data at all, and a panel without any.", empty()),
        edge("ranges", "A constant, a tiny, a huge and a narrow range.", ranges()),
        edge("long-names", "Names that do not fit.", long_names()),
        edge("many-series", "Seven series; <&> is escaped.", many_series()),
        edge("missing", "Estimates that are missing, one seed each.", missing()),
        edge("large-matrix", "More cells than numbers fit.", large_matrix()),
    ]
}

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// The return of one seed of `arm` at `progress` (0 to 1) through the training on `level`.
fn learned(arm: usize, level: usize, progress: f64, luck: f64) -> f64 {
    let slowness = 0.06 + 0.03 * (arm * level) as f64 + 0.05 * luck;
    let reached = OPTIMA[level] - 22.0 * (arm * level) as f64 * (0.3 + luck);
    -200.0 + (reached + 200.0) * (1.0 - (-progress / slowness).exp())
}

fn seeds_of(arm: usize, levels: std::ops::Range<usize>, points: usize) -> Vec<Vec<(f64, f64)>> {
    (0..NUM_SEEDS)
        .map(|seed| {
            let mut rng = rng((arm * 100 + seed) as u64);
            let luck: f64 = rng.random();
            let mut curve = Vec::new();
            for (stage, level) in levels.clone().enumerate() {
                for point in 0..points {
                    let progress = (point as f64 + 1.0) / points as f64;
                    let noise = (rng.random::<f64>() - 0.5) * 30.0 * (1.2 - progress);
                    let y = (learned(arm, level, progress, luck) + noise).clamp(-200.0, OPTIMA[level]);
                    curve.push(((stage as f64 + progress) * STAGE, y));
                }
            }
            curve
        })
        .collect()
}

/// Mean and an interval of two standard errors over `seeds`.
fn summarised(name: &str, style: usize, seeds: Vec<Vec<(f64, f64)>>) -> Curve {
    let mut curve = Curve::new(name, Style(style));
    for i in 0..seeds[0].len() {
        let values: Vec<f64> = seeds.iter().map(|seed| seed[i].1).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64;
        let half = 2.0 * (variance / values.len() as f64).sqrt();
        let x = seeds[0][i].0;
        curve.centre.push((x, mean));
        curve.band.push((x, mean - half, mean + half));
    }
    curve.seeds = seeds;
    curve
}

fn stages() -> Vec<Stage> {
    (0..LEVELS)
        .map(|level| Stage {
            from: level as f64 * STAGE,
            to: (level + 1) as f64 * STAGE,
            label: format!("level {level}"),
            short: level.to_string(),
        })
        .collect()
}

fn planners() -> Vec<Reference> {
    let along = |values: [f64; LEVELS]| {
        let segment = |(i, value)| Segment { from: i as f64 * STAGE, to: (i + 1) as f64 * STAGE, value };
        values.into_iter().enumerate().map(segment).collect()
    };
    vec![
        Reference { name: "A*".to_owned(), segments: along(A_STAR) },
        Reference { name: "optimum".to_owned(), segments: along(OPTIMA) },
    ]
}

fn curriculum(arms: &[&str]) -> Drawing {
    let curve = |(arm, name): (usize, &&str)| summarised(name, arm, seeds_of(arm, 0..LEVELS, 250));
    CurveChart {
        about: About::new("Return over the curriculum", "Both arms learn level 0; PPO with L2 falls behind later."),
        x: Axis::new("timesteps"),
        y: Axis::new("return"),
        panels: vec![CurvePanel {
            curves: arms.iter().enumerate().map(curve).collect(),
            references: planners(),
            stages: stages(),
            ..CurvePanel::default()
        }],
        ..CurveChart::default()
    }
    .draw()
}

fn wide_curriculum() -> Drawing {
    let panel = |(arm, name): (usize, &&str)| CurvePanel {
        title: (*name).to_owned(),
        curves: vec![summarised(name, arm, seeds_of(arm, 0..LEVELS, 250))],
        references: planners(),
        stages: stages(),
    };
    CurveChart {
        about: About::new("Return over the curriculum, by arm", "One panel for each arm."),
        layout: Layout { width: Width::Page, columns: 2, panel_height: 100.0 },
        x: Axis::new("timesteps"),
        y: Axis::new("return"),
        panels: ARMS.iter().enumerate().map(panel).collect(),
        ..CurveChart::default()
    }
    .draw()
}

fn from_scratch() -> Drawing {
    let panel = |level: usize| CurvePanel {
        title: format!("level {level}"),
        curves: vec![
            summarised("curriculum", 0, seeds_of(2, level..level + 1, 100)),
            summarised("from scratch", 1, seeds_of(1, level..level + 1, 100)),
        ],
        references: vec![Reference::across("A*", A_STAR[level]), Reference::across("optimum", OPTIMA[level])],
        ..CurvePanel::default()
    };
    CurveChart {
        about: About::new("Curriculum against from scratch", "The curriculum learns the later levels less well."),
        layout: Layout { width: Width::Page, columns: 3, panel_height: 90.0 },
        x: Axis::new("timesteps on the level"),
        y: Axis::new("return"),
        panels: (0..LEVELS).map(panel).collect(),
        ..CurveChart::default()
    }
    .draw()
}

fn plasticity() -> Drawing {
    let measures: [(&str, f64, f64); 6] = [
        ("dormant units, τ = 0.1 (%)", 0.0, 35.0),
        ("saturated units, |h| > 0.99 (%)", 2.0, 60.0),
        ("effective rank", 58.0, 21.0),
        ("weight magnitude, layer 1", 0.03, 0.11),
        ("gradient norm before clipping", 1e-5, 9e-5),
        ("policy churn", 120_000.0, 30_000.0),
    ];
    let panel = |(i, (title, from, to)): (usize, &(&str, f64, f64))| CurvePanel {
        title: (*title).to_owned(),
        curves: (0..2)
            .map(|arm| {
                let seeds = (0..NUM_SEEDS)
                    .map(|seed| {
                        let mut rng = rng((1000 + i * 10 + seed) as u64);
                        let mut share: f64 = 0.0;
                        (0..=100)
                            .map(|step| {
                                share += (rng.random::<f64>() - 0.35 - 0.1 * arm as f64) / 60.0;
                                (f64::from(step) * 25_000.0, from + share * (to - from))
                            })
                            .collect()
                    })
                    .collect();
                summarised(ARMS[arm], arm, seeds)
            })
            .collect(),
        stages: stages(),
        ..CurvePanel::default()
    };
    CurveChart {
        about: About::new("Plasticity", "Six measures during training."),
        layout: Layout { width: Width::Page, columns: 3, panel_height: 80.0 },
        x: Axis::new("timesteps"),
        free_y: true,
        panels: measures.iter().enumerate().map(panel).collect(),
        ..CurveChart::default()
    }
    .draw()
}

fn estimate(rng: &mut ChaCha8Rng, value: f64, spread: f64) -> Option<Estimate> {
    let seeds: Vec<f64> = (0..NUM_SEEDS).map(|_| value + (rng.random::<f64>() - 0.5) * 4.0 * spread).collect();
    Some(Estimate { value, interval: Some((value - spread, value + spread)), seeds })
}

fn final_returns() -> Drawing {
    let mut rng = rng(7);
    let series = (0..ARMS.len())
        .map(|arm| IntervalSeries {
            name: ARMS[arm].to_owned(),
            style: Style(arm),
            estimates: (0..LEVELS).map(|level| estimate(&mut rng, learned(arm, level, 1.0, 0.4), 6.0)).collect(),
        })
        .collect();
    let level_by_level = |values: [f64; LEVELS]| {
        let segment = |(i, value)| Segment { from: i as f64, to: (i + 1) as f64, value };
        values.into_iter().enumerate().map(segment).collect()
    };
    IntervalChart {
        about: About::new("Average return", "Of each arm on each level."),
        layout: Layout { width: Width::Page, columns: 1, panel_height: 140.0 },
        values: Axis::new("average return"),
        panels: vec![IntervalPanel {
            categories: (0..LEVELS).map(|level| format!("level {level}")).collect(),
            series,
            references: vec![
                Reference { name: "A*".to_owned(), segments: level_by_level(A_STAR) },
                Reference { name: "optimum".to_owned(), segments: level_by_level(OPTIMA) },
            ],
            ..IntervalPanel::default()
        }],
        ..IntervalChart::default()
    }
    .draw()
}

fn continual() -> Drawing {
    let mut rng = rng(8);
    let panel = |(title, centre): (&str, f64)| IntervalPanel {
        title: title.to_owned(),
        categories: vec![String::new()],
        series: (0..ARMS.len())
            .map(|arm| IntervalSeries {
                name: ARMS[arm].to_owned(),
                style: Style(arm),
                estimates: vec![estimate(&mut rng, centre - 0.08 * arm as f64, 0.05)],
            })
            .collect(),
        references: if centre < 0.3 { vec![Reference::across("no effect", 0.0)] } else { Vec::new() },
    };
    IntervalChart {
        about: About::new("Continual learning", "Average performance, backward and forward transfer."),
        layout: Layout { width: Width::Column, columns: 3, panel_height: 90.0 },
        values: Axis::new("normalised return"),
        panels: [("average performance", 0.8), ("backward transfer", -0.1), ("forward transfer", 0.2)]
            .map(panel)
            .to_vec(),
        ..IntervalChart::default()
    }
    .draw()
}

fn improvement() -> Drawing {
    let mut rng = rng(9);
    let pairs = ["PPO > PPO with L2", "PPO > PPO-ε", "PPO > DQN", "PPO with L2 > DQN"];
    let estimates = [0.81, 0.55, 0.97, 0.62].iter().map(|p| estimate(&mut rng, *p, 0.08)).map(|estimate| {
        estimate.map(|estimate| Estimate {
            interval: estimate.interval.map(|(lower, upper)| (lower, upper.min(1.0))),
            seeds: Vec::new(),
            ..estimate
        })
    });
    IntervalChart {
        about: About::new("Probability of improvement", "Between arms, with 95% intervals."),
        layout: Layout { panel_height: 70.0, ..Layout::default() },
        orientation: Orientation::Horizontal,
        values: Axis { range: Some((0.0, 1.0)), ..Axis::new("probability of improvement") },
        panels: vec![IntervalPanel {
            categories: pairs.map(str::to_owned).to_vec(),
            series: vec![IntervalSeries { estimates: estimates.collect(), ..IntervalSeries::default() }],
            references: vec![Reference::across("no difference", 0.5)],
            ..IntervalPanel::default()
        }],
        ..IntervalChart::default()
    }
    .draw()
}

fn levels() -> Vec<String> {
    (0..LEVELS).map(|level| level.to_string()).collect()
}

fn matrix() -> Drawing {
    let cell = |stage: usize, level: usize| {
        let forgotten = if level > stage { 225.0 } else { 31.7 * (stage - level) as f64 };
        (stage < 4 || level < 3).then_some((OPTIMA[level] - forgotten).max(-200.0))
    };
    HeatMap {
        about: About::new("Return matrix", "Rows are stages, columns levels; the upper triangle was not trained yet."),
        row_label: "after training on level".to_owned(),
        column_label: "evaluated on level".to_owned(),
        values: Axis::new("return"),
        decimals: 1,
        panels: vec![HeatPanel {
            rows: levels(),
            columns: levels(),
            cells: (0..LEVELS).map(|stage| (0..LEVELS).map(|level| cell(stage, level)).collect()).collect(),
            ..HeatPanel::default()
        }],
        ..HeatMap::default()
    }
    .draw()
}

fn forgetting() -> Drawing {
    let panel = |(arm, name): (usize, &&str)| HeatPanel {
        title: (*name).to_owned(),
        rows: levels(),
        columns: levels(),
        cells: (0..LEVELS)
            .map(|stage| {
                (0..LEVELS)
                    .map(|level| (level <= stage).then(|| 8.0 - 13.0 * ((arm + 1) * (stage - level)) as f64))
                    .collect()
            })
            .collect(),
    };
    HeatMap {
        about: About::new("Forgetting", "Differences to the return when the level was learned."),
        layout: Layout { width: Width::Page, columns: 4, ..Layout::default() },
        row_label: "after level".to_owned(),
        column_label: "evaluated on level".to_owned(),
        values: Axis::new("change of return"),
        panels: ARMS.iter().enumerate().map(panel).collect(),
        ..HeatMap::default()
    }
    .draw()
}

fn maps() -> Drawing {
    let drawn = [
        "........\n........\n....TTT.\n....#TT.\n....TTT.\n........\n........\n........",
        "........\n........\n...##...\n...#....\n.TTT....\n.TTT....\n.TTT....\n........",
        "TT##....\nTT#...##\nTTT...##\n........\n........\n........\n...##...\n...##...",
        "..##....\n..##TTT.\n....TT#.\n.#..TT#.\n.##.....\n........\n...#....\n........",
        "....##..\n#...##..\n##.....#\n........\n..#..#..\n.T#T.#..\n.TTT....\n.TTT....",
    ];
    let tile = |c: char| match c {
        '#' => Tile::Wall,
        'T' => Tile::Target,
        _ => Tile::Free,
    };
    let map = |(level, text): (usize, &str)| GridMap {
        title: format!("level {level}"),
        tiles: text.lines().map(|row| row.chars().map(tile).collect()).collect(),
    };
    GridMaps {
        about: About::new("Maps", "The five levels."),
        layout: Layout { width: Width::Page, columns: 5, ..Layout::default() },
        maps: drawn.into_iter().enumerate().map(map).collect(),
    }
    .draw()
}

fn one_seed() -> Drawing {
    let gone = |i: usize| (60..90).contains(&i) || i == 120 || i == 122;
    let points = seeds_of(0, 0..1, 200).swap_remove(0);
    let centre = points.into_iter().enumerate().map(|(i, (x, y))| (x, if gone(i) { f64::NAN } else { y })).collect();
    CurveChart {
        about: About::new("One seed", "With gaps."),
        x: Axis::new("timesteps"),
        y: Axis::new("return"),
        panels: vec![CurvePanel {
            curves: vec![Curve { centre, ..Curve::new("PPO, 1 seed", Style(0)) }],
            ..CurvePanel::default()
        }],
        ..CurveChart::default()
    }
    .draw()
}

fn empty() -> Drawing {
    let nan = Curve { centre: vec![(0.0, f64::NAN), (1.0, f64::NAN)], ..Curve::new("never finished", Style(1)) };
    let some = Curve { centre: vec![(0.0, 1.0), (1.0, 2.0)], ..Curve::new("finished", Style(0)) };
    let panel = |title: &str, curves| CurvePanel { title: title.to_owned(), curves, ..CurvePanel::default() };
    CurveChart {
        about: About::new("No data", "In all but one panel."),
        layout: Layout { columns: 3, panel_height: 60.0, ..Layout::default() },
        x: Axis::new("x"),
        y: Axis::new("y"),
        panels: vec![panel("some", vec![some]), panel("not finite", vec![nan]), panel("nothing", Vec::new())],
        ..CurveChart::default()
    }
    .draw()
}

fn ranges() -> Drawing {
    let panel = |(title, low, high): (&str, f64, f64)| CurvePanel {
        title: title.to_owned(),
        curves: vec![Curve {
            centre: (0..=20).map(|i| (f64::from(i), low + (high - low) * f64::from(i % 7) / 6.0)).collect(),
            ..Curve::new("", Style(0))
        }],
        ..CurvePanel::default()
    };
    CurveChart {
        about: About::new("Ranges", "Four panels with their own."),
        layout: Layout { columns: 2, panel_height: 60.0, ..Layout::default() },
        x: Axis { unit: Some("s".to_owned()), ..Axis::new("time") },
        free_y: true,
        panels: [
            ("constant", 45.0, 45.0),
            ("tiny", -3e-9, 5e-9),
            ("huge", -4e20, 7e21),
            ("narrow", 1_000_000.0, 1_000_003.0),
        ]
        .map(panel)
        .to_vec(),
        ..CurveChart::default()
    }
    .draw()
}

fn long_names() -> Drawing {
    let mut rng = rng(3);
    let names = [
        "PPO with decoupled weight decay and layer normalisation",
        "DQN with a replay buffer that is emptied between levels",
    ];
    let series = names.iter().enumerate().map(|(i, name)| IntervalSeries {
        name: format!("{name}, evaluated greedily with ties broken at random, 100 episodes per seed"),
        style: Style(i),
        estimates: (0..4).map(|level| estimate(&mut rng, -10.0 * f64::from(level), 4.0)).collect(),
    });
    IntervalChart {
        about: About::new("Long names", "Everywhere."),
        values: Axis::new("average undiscounted return over one hundred evaluation episodes"),
        category_label: "level of the curriculum".to_owned(),
        panels: vec![IntervalPanel {
            title: "A panel whose title says far more than any title of a panel in one column should".to_owned(),
            categories: [
                "open field",
                "corridors and narrow passages",
                "two rooms",
                "Labyrinthspaziergang durchs Gebirge",
            ]
            .map(str::to_owned)
            .to_vec(),
            series: series.collect(),
            ..IntervalPanel::default()
        }],
        ..IntervalChart::default()
    }
    .draw()
}

fn many_series() -> Drawing {
    let curve = |i: usize| Curve {
        centre: (0..=60).map(|x| (f64::from(x), (f64::from(x) / 9.0 + i as f64 / 1.3).sin() + i as f64)).collect(),
        ..Curve::new(format!("arm {i} <&>"), Style(i))
    };
    CurveChart {
        about: About::new("Seven <series> & more", "All styles."),
        x: Axis { unit: Some("episodes".to_owned()), ..Axis::new("age") },
        y: Axis::new("f(x) < 8"),
        panels: vec![CurvePanel { curves: (0..7).map(curve).collect(), ..CurvePanel::default() }],
        ..CurveChart::default()
    }
    .draw()
}

fn missing() -> Drawing {
    let one = |value: f64| Some(Estimate { value, interval: None, seeds: Vec::new() });
    let series = vec![
        IntervalSeries { name: "PPO".to_owned(), style: Style(0), estimates: vec![one(3.0), None, one(f64::NAN)] },
        IntervalSeries { name: "DQN".to_owned(), style: Style(3), estimates: vec![one(1.0), one(2.0)] },
    ];
    let panel = |title: &str, series| IntervalPanel {
        title: title.to_owned(),
        categories: ["level 0", "level 1", "level 2"].map(str::to_owned).to_vec(),
        series,
        ..IntervalPanel::default()
    };
    IntervalChart {
        about: About::new("Missing", "Some estimates are."),
        layout: Layout { columns: 2, panel_height: 80.0, ..Layout::default() },
        values: Axis::new("return"),
        panels: vec![panel("some", series), panel("all missing", Vec::new())],
        ..IntervalChart::default()
    }
    .draw()
}

fn large_matrix() -> Drawing {
    let names: Vec<String> = (0..30).map(|i| format!("task {i}")).collect();
    HeatMap {
        about: About::new("Large matrix", "30 × 30."),
        row_label: "stage".to_owned(),
        column_label: "task".to_owned(),
        values: Axis::new("score"),
        panels: vec![HeatPanel {
            cells: (0..30).map(|i| (0..30).map(|j| (j <= i).then(|| f64::from(i * j))).collect()).collect(),
            rows: names.clone(),
            columns: names,
            ..HeatPanel::default()
        }],
        ..HeatMap::default()
    }
    .draw()
}
