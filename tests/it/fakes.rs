//! Runs that are written here, every number of which is known.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use coverage_env::Level;
use coverage_env::planner::Optimal;
use cpp_rl::evaluate::{self, Starts};
use cpp_rl::report::Format;
use cpp_rl::report::analysis::Analysis;
use cpp_rl::report::exhibits::{self, NamedTable};
use cpp_rl::run::manifest::{Engine, ForkEntry, Host, Manifest, StageEntry, Start, Status, Versions};
use serde_json::json;
use tempfile::TempDir;

pub(crate) const MAPS: [(&str, &str); 2] = [("a", "..#.\n.T..\n...T\n"), ("b", "T...\n..#.\n..#T\n")];
pub(crate) const MAX_STEPS: u32 = 20;
pub(crate) const TIMESTEPS: u64 = 1000;

/// How an agent does in an evaluation.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Skill {
    /// As well as can be, from every start.
    Perfect,
    /// Not at all.
    Lost,
}

/// A run to be written.
#[derive(Clone, Copy)]
pub(crate) struct Fake {
    pub(crate) arm: &'static str,
    pub(crate) seed: u64,
    pub(crate) levels: &'static [&'static str],
    pub(crate) from_scratch: bool,
    pub(crate) stages_done: u16,
    /// Of each stage.
    pub(crate) timesteps: u64,
    /// In the evaluation after a stage (none: before the first) on a level, both by number.
    pub(crate) skill: fn(Option<usize>, usize) -> Skill,
    /// The same of the sampled policy; none of a run of version 0.1.0.
    pub(crate) sampled: Option<fn(Option<usize>, usize) -> Skill>,
    /// The normalised moving return at a share of a stage, given its level's name.
    pub(crate) curve: fn(&str, f64) -> f64,
    /// How it stands, given whether all stages are done.
    pub(crate) status: fn(bool) -> Status,
    /// The commit that made it.
    pub(crate) commit: &'static str,
    /// The instruction set of its engine.
    pub(crate) instruction_set: &'static str,
    /// Timesteps that its schedules span, if it was extended.
    pub(crate) horizon: Option<u64>,
    /// The name of its sequence, unless it is from scratch.
    pub(crate) sequence: &'static str,
    /// The stage after which it goes on, and the treatment's name, if it is a fork.
    pub(crate) fork: Option<(u16, &'static str)>,
}

pub(crate) const CURRICULUM: Fake = Fake {
    arm: "ppo",
    seed: 0,
    levels: &["a", "b"],
    from_scratch: false,
    stages_done: 2,
    timesteps: TIMESTEPS,
    // What was trained last is known, and nothing else.
    skill: |stage, level| if stage == Some(level) { Skill::Perfect } else { Skill::Lost },
    sampled: None,
    curve: |_, share| share,
    status: |finished| if finished { Status::Finished } else { Status::Running },
    commit: "abc",
    instruction_set: "avx2",
    horizon: None,
    sequence: "curriculum",
    fork: None,
};

pub(crate) const FROM_SCRATCH_B: Fake = Fake {
    levels: &["b"],
    from_scratch: true,
    stages_done: 1,
    skill: |_, _| Skill::Perfect,
    curve: |_, _| 1.0,
    ..CURRICULUM
};

pub(crate) fn map(level: &str) -> String {
    let own = MAPS.iter().find(|(name, _)| *name == level).map(|(_, map)| (*map).to_owned());
    own.or_else(|| Level::builtin(level).map(|level| level.to_map())).expect("a level that is known")
}

pub(crate) fn max_steps(level: &str) -> u32 {
    if Level::builtin(level).is_some() { 200 } else { MAX_STEPS }
}

impl Fake {
    fn sequence(&self) -> String {
        if self.from_scratch { format!("level-{}", self.levels[0]) } else { self.sequence.to_owned() }
    }

    /// Its directory below `root`.
    pub(crate) fn path(&self, root: &Path) -> PathBuf {
        let folder = root.join(self.arm).join(self.sequence()).join(format!("seed-{}", self.seed));
        match self.fork {
            Some((after, name)) => {
                root.join(format!("forks-{after}-{name}")).join(Self { fork: None, ..*self }.path("".as_ref()))
            }
            None => folder,
        }
    }

    /// The number of the first stage that it trains.
    fn first(&self) -> usize {
        self.fork.map_or(0, |(after, _)| usize::from(after) + 1)
    }

    pub(crate) fn write(&self, root: &Path) -> PathBuf {
        let path = self.path(root);
        fs::create_dir_all(&path).expect("a folder");
        let stage = |level: &&str| StageEntry {
            level: (*level).to_owned(),
            map: map(level),
            timesteps: self.timesteps,
            horizon: self.horizon,
        };
        let versions = Versions { cpp_rl: "1.0".to_owned(), git: self.commit.to_owned(), libtorch: "2.0".to_owned() };
        let host = Host { name: String::new(), platform: String::new(), cores: 1 };
        let start = Start {
            time: String::new(),
            command: Vec::new(),
            versions: versions.clone(),
            host: host.clone(),
            instruction_set: self.instruction_set.to_owned(),
            timesteps: 0,
        };
        let mut config =
            json!({ "name": self.arm, "max_steps": max_steps(self.levels[0]), "timesteps": self.timesteps });
        // As the arms of a sweep are named.
        for (key, value) in self.arm.split('+').filter_map(|part| part.split_once('-')) {
            if let Ok(value) = value.parse::<f64>() {
                config[key] = value.into();
            }
        }
        let fork = self.fork.map(|(after, name)| {
            // A treatment may change settings.
            config["treated"] = name.into();
            let parent = Self { fork: None, ..*self }.path(Path::new("elsewhere")).display().to_string();
            ForkEntry { parent, after, name: name.to_owned(), treatment: serde_json::Map::new() }
        });
        let finished = usize::from(self.stages_done) == self.levels.len();
        let mut manifest = Manifest {
            format: 1,
            status: (self.status)(finished),
            arm: self.arm.to_owned(),
            curriculum: self.sequence(),
            seed: self.seed,
            fork,
            stages: self.levels.iter().map(stage).collect(),
            stages_done: self.stages_done,
            marks: Vec::new(),
            levels: self.levels.iter().map(|level| (*level).to_owned()).collect(),
            config: config.as_object().expect("an object").clone(),
            dose: None,
            engine: Engine::Fused,
            device: "cpu".to_owned(),
            plasticity_interval: 0,
            evaluate_every: 0,
            versions,
            host,
            command: Vec::new(),
            starts: vec![start],
            started: String::new(),
            updated: String::new(),
            seconds: 0.0,
        };
        manifest.write(&path).expect("a manifest");
        fs::write(path.join("evaluations.csv"), self.evaluations()).expect("evaluations");
        fs::write(path.join("progress.csv"), self.progress(self.timesteps / 4)).expect("a log");
        path
    }

    /// Evaluations before the first stage and after every stage, finished or not.
    fn evaluations(&self) -> String {
        let columns = if self.sampled.is_some() { ",policy" } else { "" };
        let mut text = format!("phase,stage,level,start,return,length,solved{columns}\n");
        let policies: Vec<_> = match self.sampled {
            Some(sampled) => vec![(self.skill, ",greedy"), (sampled, ",sampled")],
            None => vec![(self.skill, "")],
        };
        let times = [None].into_iter().chain((self.first()..self.levels.len()).map(Some));
        for stage in times {
            for ((skill, policy), (number, name)) in
                policies.iter().flat_map(|policy| self.levels.iter().enumerate().map(move |level| (policy, level)))
            {
                let phase = if stage.is_some() { "after" } else { "before" };
                let limit = max_steps(name);
                for best in optimum(name).episodes {
                    let (return_, length, solved) = match skill(stage, number) {
                        Skill::Perfect => (best.return_, best.length, true),
                        Skill::Lost => (-i64::from(limit), limit, false),
                    };
                    let (stage, [row, column]) = (stage.unwrap_or(self.first()), best.start);
                    writeln!(text, "{phase},{stage},{name},{row} {column},{return_},{length},{solved}{policy}")
                        .expect("memory");
                }
            }
        }
        text
    }

    /// A row every so many timesteps.
    pub(crate) fn progress(&self, every: u64) -> String {
        let mut text = "stage,level,time/total_timesteps,cumulative_timesteps,rollout/ep_rew_mean\n".to_owned();
        for (stage, level) in self.levels.iter().enumerate().skip(self.first()) {
            let (worst, best) = (-f64::from(max_steps(level)), optimum(level).mean);
            for timesteps in (every..=self.timesteps).step_by(every as usize) {
                let value = worst + (best - worst) * (self.curve)(level, timesteps as f64 / self.timesteps as f64);
                let cumulative = stage as u64 * self.timesteps + timesteps;
                writeln!(text, "{stage},{level},{timesteps},{cumulative},{value}").expect("memory");
            }
        }
        text
    }
}

pub(crate) fn optimum(level: &str) -> cpp_rl::results::LevelResult {
    let limit = max_steps(level);
    let level = Arc::new(Level::from_map(level, &map(level)).expect("a valid map"));
    evaluate::planner(&mut Optimal::new(), &level, limit, Starts::Exhaustive).expect("a level within reach")
}

pub(crate) fn read(root: &TempDir) -> Analysis {
    Analysis::read(&[root.path().to_owned()]).expect("runs that can be read")
}

/// The analysis of these runs.
pub(crate) fn analysis(runs: &[Fake]) -> Analysis {
    let root = TempDir::new().expect("a folder");
    runs.iter().for_each(|run| {
        run.write(root.path());
    });
    read(&root)
}

/// Every table of its report.
pub(crate) fn tables(analysis: &Analysis) -> Vec<NamedTable> {
    let sections = exhibits::sections(analysis, &exhibits::all(analysis));
    sections.into_iter().flat_map(|section| section.tables).collect()
}

/// One of them.
pub(crate) fn table(analysis: &Analysis, name: &str, format: Format) -> String {
    let all = tables(analysis);
    let named = all.iter().find(|named| named.name == name);
    named.unwrap_or_else(|| panic!("no table {name}")).table.render(format)
}
