use super::*;

fn parse(text: &str) -> Result<Study> {
    Study::parse(text, Path::new("study.yaml"), None)
}

/// `arm/sequence: stages` of everything that is trained for these seeds.
fn planned(text: &str, seeds: &[u64]) -> Vec<String> {
    let study = parse(text).unwrap_or_else(|error| panic!("{error:#} in\n{text}"));
    let show = |Planned { config, curriculum, seeds, fork }: Planned<'_>| {
        let stages = curriculum.trained().iter().map(|s| format!("{}×{}", s.level.name(), s.timesteps));
        let stages = stages.collect::<Vec<_>>().join(" ");
        let suffix = fork.map_or_else(String::new, |(fork, _)| fork.suffix());
        format!("{}/{}{suffix}: {stages} for {seeds:?}", config.name, curriculum.name)
    };
    study.experiments(seeds).unwrap().into_iter().map(show).collect()
}

#[test]
fn the_paper_has_its_arms_and_levels() {
    let study = Study::paper(None).unwrap();
    let names: Vec<&str> = study.arms.iter().map(|arm| arm.config.name.as_str()).collect();
    assert_eq!(names, ["dqn", "ppo", "ppo-l2", "dqn-constant-eps", "ppo-eps", "ppo-l2-dohare"]);
    let experiments = study.experiments(&[0]).unwrap();
    // Six curricula, and five arms on five levels from scratch.
    assert_eq!(experiments.len(), 6 + 5 * 5);
    let timesteps: u64 = experiments.iter().map(|planned| planned.curriculum.timesteps()).sum();
    assert_eq!(timesteps, 4 * 5_000_000 + 7 * 2_500_000);
    let short = Study::paper(Some(1000)).unwrap();
    assert!(short.arms.iter().all(|arm| arm.config.shared.timesteps == 1000));
}

#[test]
fn an_arm_may_have_settings_and_a_name_of_its_own() {
    let text = "name: mine\nlevels: [\"0\", 3]\narms:\n  - {algo: ppo, trains: [curriculum]}\n  \
                - {algo: ppo, set: [name=fast, learning_rate=3e-4], trains: [from scratch]}\n";
    let study = parse(text).unwrap();
    assert_eq!(study.arms[1].config.name, "fast");
    assert_eq!(study.arms[1].config.shared.optimizer.learning_rate, 3e-4);
    assert_eq!(study.arms[1].trains, [Training::FromScratch]);
    let expected = [
        "ppo/curriculum: 0×500000 3×500000 for [0, 1]",
        "fast/level-0: 0×500000 for [0, 1]",
        "fast/level-3: 3×500000 for [0, 1]",
    ];
    assert_eq!(planned(text, &[0, 1]), expected);
}

#[test]
fn files_that_say_afresh_are_still_read() {
    let study = parse("name: old\nlevels: [0]\narms: [{algo: ppo, trains: [curriculum, afresh]}]\n").unwrap();
    assert_eq!(study.arms[0].trains, [Training::Curriculum, Training::FromScratch]);
}

#[test]
fn levels_come_again() {
    let text = "name: x\nlevels: [0, 1, 0]\narms: [{algo: ppo, trains: [curriculum, from scratch]}]\n";
    let expected = [
        "ppo/curriculum: 0×500000 1×500000 0×500000 for [0]",
        "ppo/level-0: 0×500000 for [0]",
        "ppo/level-1: 1×500000 for [0]",
    ];
    assert_eq!(planned(text, &[0]), expected);
    let cycles = "name: x\nsequence: {levels: [0, 1], repeat: 2, timesteps: [5, 6]}\n\
                  arms: [{algo: ppo, trains: [curriculum, from scratch]}]\n";
    let expected = ["ppo/curriculum: 0×5 1×6 0×5 1×6 for [0]", "ppo/level-0: 0×5 for [0]", "ppo/level-1: 1×6 for [0]"];
    assert_eq!(planned(cycles, &[0]), expected);
}

#[test]
fn timesteps_of_all_stages_are_the_setting_of_that_name() {
    let text = "name: x\nsequence: {levels: [0, 1], timesteps: 7}\narms: [{algo: ppo, trains: [curriculum]}]\n";
    assert_eq!(parse(text).unwrap().arms[0].config.shared.timesteps, 7);
    let short = Study::parse(text, Path::new("study.yaml"), Some(3)).unwrap();
    assert_eq!(short.arms[0].config.shared.timesteps, 3);
    assert_eq!(short.experiments(&[0]).unwrap()[0].curriculum.timesteps(), 6);
}

#[test]
fn orders_are_all_balanced_or_ones_own() {
    let with = |sequence: &str| {
        format!("name: x\nlevels: [0, 1, 2]\nsequence: {sequence}\narms: [{{algo: ppo, trains: [curriculum]}}]\n")
    };
    let names = |sequence: &str, seeds: &[u64]| -> Vec<String> {
        let of_run = |run: String| run.split_once(": ").unwrap().0.strip_prefix("ppo/").unwrap().to_owned();
        planned(&with(sequence), seeds).into_iter().map(of_run).collect()
    };
    let all = ["order-012", "order-021", "order-102", "order-120", "order-201", "order-210"];
    assert_eq!(names("{order: all}", &[0]), all);
    let mut balanced = names("{order: williams}", &[0]);
    balanced.sort();
    assert_eq!(balanced, all, "of three levels, a Williams design has all orders");
    assert_eq!(names("{order: [[0, 1], [2, 0]]}", &[0]), ["order-01", "order-20"]);
    assert_eq!(names("{order: {there: [0, 1], back: [1, 0]}}", &[0]), ["there", "back"]);
    assert_eq!(names("{shift: by-seed}", &[0, 1, 3]), ["order-012", "order-120"]);
    assert_eq!(names("{order: all, seeds: in-turn}", &[0, 3, 9]), ["order-012", "order-120"]);
    assert_eq!(names("{levels: [2, 0]}", &[0]), ["curriculum"]);
    assert_eq!(names("[2, 0]", &[0]), ["curriculum"]);
}

#[test]
fn an_arm_may_have_a_sequence_of_its_own() {
    let text = "name: x\nlevels: [0, 1]\narms:\n  - {algo: ppo, trains: [curriculum]}\n  \
                - {algo: dqn, trains: [curriculum], sequence: {levels: [2], timesteps: 9}}\n";
    assert_eq!(planned(text, &[0]), ["ppo/curriculum: 0×500000 1×500000 for [0]", "dqn/curriculum: 2×9 for [0]"]);
}

#[test]
fn generated_levels_are_the_same_every_time() {
    let text = "name: x\nlevels:\n  generate: {height: 5, width: 6, wall_density: 0.1, targets: 2, count: 3, seed: 7}\n\
                arms: [{algo: ppo, trains: [curriculum]}]\n";
    let levels = |study: &Study| study.experiments(&[0]).unwrap().remove(0).curriculum.levels;
    let (once, again) = (levels(&parse(text).unwrap()), levels(&parse(text).unwrap()));
    assert_eq!(once, again);
    let names: Vec<&str> = once.iter().map(|level| level.name()).collect();
    assert_eq!(names, ["generated-5x6-w3-t2-s7", "generated-5x6-w3-t2-s8", "generated-5x6-w3-t2-s9"]);
    // Beside others, and by name in an order.
    let beside = "name: x\nlevels: [0, {generate: {seed: 1}}]\n\
                  sequence: {order: [[generated-8x8-w13-t8-s1, 0]]}\narms: [{algo: ppo, trains: [curriculum]}]\n";
    let expected = ["ppo/curriculum: generated-8x8-w13-t8-s1×500000 0×500000 for [0]"];
    assert_eq!(planned(beside, &[0]), expected);
}

#[test]
fn a_grid_is_an_arm_for_each_cell() {
    let text = "name: x\nlevels: [0]\narms:\n  - {algo: ppo-l2-dohare, set: [name=l2], trains: [curriculum], \
                grid: {l2_coef: [1e-5, 1e-4], hidden: [[8], [8, 8]]}}\n";
    let study = parse(text).unwrap();
    let names: Vec<&str> = study.arms.iter().map(|arm| arm.config.name.as_str()).collect();
    let expected = [
        "l2+l2_coef-1e-5+hidden-8",
        "l2+l2_coef-1e-5+hidden-8x8",
        "l2+l2_coef-1e-4+hidden-8",
        "l2+l2_coef-1e-4+hidden-8x8",
    ];
    assert_eq!(names, expected);
    assert_eq!(study.arms[3].config.shared.hidden, [8, 8]);
}

#[test]
fn mistakes_are_named_with_their_place() {
    let with = |levels: &str, arms: &str| format!("name: x\nlevels: {levels}\narms:\n{arms}");
    let one = "  - {algo: ppo, trains: [curriculum]}\n";
    let seq = |sequence: &str| {
        format!("name: x\nlevels: [0, 1]\nsequence: {sequence}\narms: [{{algo: ppo, trains: [curriculum]}}]\n")
    };
    let grid = |grid: &str| with("[0]", &format!("  - algo: ppo\n    trains: [curriculum]\n    grid: {grid}\n"));
    for (text, says) in [
        (with("[0]", "  - {algo: pop, trains: [from scratch]}\n"), "study.yaml:4:5: this arm: --algo: unknown preset"),
        (with("[0]", "  - {algo: ppo, trains: []}\n"), "study.yaml:4:25: trains: the list is empty: name curriculum"),
        (
            with("[0]", "  - {algo: ppo, trains: [twice]}\n"),
            "study.yaml:4:26: trains: expected curriculum or from scratch",
        ),
        (with("[0]", "  - {algo: ppo}\n"), "study.yaml:4:5: an arm has no \"trains\": add it"),
        (
            with("[0]", "  - {algo: ppo, train: [curriculum]}\n"),
            "unknown key \"train\" in an arm; did you mean \"trains\"?",
        ),
        (with("[0]", &one.repeat(2)), "study.yaml:5:5: the arm ppo stands twice"),
        (with("[]", one), "study.yaml:2:9: levels: the list is empty: name at least one level"),
        (with("[0, 9]", one), "study.yaml:2:13: 9: neither a built-in level"),
        (with("[0, absent.yaml]", one), "study.yaml:2:13: absent.yaml: cannot be read"),
        (with("[0, [1]]", one), "study.yaml:2:13: levels: expected a level's id or path"),
        (
            with("[0, {generate: {height: 4}}]", one),
            "study.yaml:2:9: levels: all levels of a curriculum must have the same size",
        ),
        (with("{generate: {height: 0}}", one), "study.yaml:2:20: generate: a map of 0 x 8 cells"),
        (
            with("{generate: {targets: 64}}", one),
            "study.yaml:2:20: generate: 13 walls and 64 targets leave no start cell",
        ),
        (with("{generate: {wall_density: 1}}", one), "study.yaml:2:20: generate: a wall density of 1"),
        (with("{generate: {count: 0}}", one), "study.yaml:2:28: count: expected an integer from 1 to 10000, got 0"),
        (with("{generate: {size: 4}}", one), "study.yaml:2:21: unknown key \"size\" in generate; "),
        (with("{made: {size: 4}}", one), "study.yaml:2:10: unknown key \"made\" in levels; "),
        (with("[0]", one).replace("name: x", "name: ../x"), "study.yaml:1:7: name: expected 1 to 64 letters"),
        (seq("{order: al}"), "study.yaml:3:19: order: expected all, williams, or a list of orders"),
        (seq("{order: al}"), "got \"al\"; did you mean \"all\"?"),
        (seq("{order: []}"), "study.yaml:3:19: order: the list is empty"),
        (seq("{order: [0, 1]}"), "study.yaml:3:20: order: 0 is no list: name each order as a list of levels"),
        (seq("{order: [[0, 1], [0, 1]]}"), "study.yaml:3:19: sequence: order: [0, 1] stands twice"),
        (seq("{order: [[0, 1], []]}"), "study.yaml:3:28: levels: the list is empty"),
        (seq("{order: {}}"), "study.yaml:3:19: order: it names no order"),
        (seq("{order: {level-0: [0, 1]}}"), "study.yaml:3:19: sequence: order: level-0: names that begin with level-"),
        (
            seq("{levels: [0, 0], order: all}"),
            "study.yaml:3:35: order: all orders different levels, but one stands twice",
        ),
        (seq("{levels: {generate: {count: 9}}, order: all}"), "order: all orders of 9 levels are 362880: at most 8"),
        (seq("{timesteps: [1, 2, 3]}"), "study.yaml:3:23: sequence: timesteps: expected one number, or a list of 2"),
        (seq("{timesteps: 0}"), "study.yaml:3:23: timesteps: expected an integer from 1 to"),
        (seq("{repeat: 0}"), "study.yaml:3:20: repeat: expected an integer from 1 to 65535, got 0"),
        (seq("{repeat: 65535}"), "study.yaml:3:11: sequence: 131070 stages are too many"),
        (seq("{shift: by-sed}"), "study.yaml:3:19: shift: expected by-seed, got \"by-sed\"; did you mean"),
        (seq("{seeds: in-turns}"), "study.yaml:3:19: seeds: expected in-turn, got \"in-turns\"; did you mean"),
        (seq("{shift: by-seed, seeds: in-turn}"), "study.yaml:3:35: seeds: in-turn and shift: by-seed cannot both be"),
        (seq("{cycles: 2}"), "study.yaml:3:12: unknown key \"cycles\" in sequence; known keys of sequence are levels"),
        (
            grid("{l2_cof: [1]}"),
            "study.yaml:6:21: grid: unknown key \"l2_cof\" for algorithm ppo; did you mean \"l2_coef\"?",
        ),
        (grid("{gamma: [0.5, 2]}"), "study.yaml:6:25: grid: gamma: expected a number from 0 to 1, got 2"),
        (grid("{gamma: []}"), "study.yaml:6:19: grid: the list is empty"),
        (grid("{}"), "study.yaml:6:11: grid: it names no setting"),
        (
            grid("{timesteps: [1, 2]}").replace("arms:", "sequence: {timesteps: 5}\narms:"),
            "study.yaml:7:12: grid: timesteps have no effect",
        ),
        ("name: x\nlevels: [0]\narms: []\n".to_owned(), "study.yaml:3:7: arms: the list is empty: name at least one"),
        ("name: x\nlevels: [0]\n".to_owned(), "study.yaml:1:1: the study has no \"arms\": add it"),
        (
            "name: x\narms:\n  - {algo: ppo, trains: [curriculum]}\n".to_owned(),
            "study.yaml:3:5: this arm has no levels",
        ),
        ("nmae: x".to_owned(), "study.yaml:1:1: unknown key \"nmae\" in the study; did you mean \"name\"?"),
        ("name: x\nname: y\n".to_owned(), "study.yaml:2:1: not a study: "),
        ("name: [".to_owned(), "study.yaml:"),
    ] {
        let error = format!("{:#}", parse(&text).unwrap_err());
        assert!(error.contains(says), "{text:?}:\n  {error}\n  should say {says}");
    }
}
