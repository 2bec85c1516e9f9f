//! This module decides when a run's state is kept and with what beside it, and goes on from it.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::Prepared;
use crate::config::{Config, Difference};
use crate::error::{Error, ErrorKind, Result};
use crate::gpu::Gpu;
use crate::run::{CurvePoint, Found, RunDir, Stop};
use crate::scene::Scene;
use crate::train::{State, Trainer, fingerprint};
use crate::version::VERSION;

/// Default spacing of checkpoints: at least this time, and this many times as long as the last one
/// took.
const INTERVAL: Duration = Duration::from_secs(60);
const COST_MULTIPLE: u32 = 50;

/// Names of what differs that an error lists.
const MAX_LISTED: usize = 4;

/// The identity of a run, which a checkpoint must share for the run to go on from it.
#[derive(Serialize, Deserialize)]
pub(super) struct Identity {
    /// Program and adapter: on others the bits differ.
    made_by: String,
    config: Config,
    /// Checksums by name.
    scene: BTreeMap<String, u32>,
}

impl Identity {
    pub(super) fn new(gpu: &Gpu, config: &Config, scene: &Scene, start: &Prepared) -> Result<Self> {
        let mut sums = fingerprint(&start.supervision, &start.start);
        for view in &scene.test {
            let name = &view.camera.name;
            let image = crc32fast::hash(&view.image.rgb);
            sums.insert(format!("test image of `{name}`"), image);
            let set = view.mask.iter().flat_map(|mask| &mask.set);
            let mask: Vec<u8> = set.map(|&set| set.into()).collect();
            sums.insert(format!("test mask of `{name}`"), crc32fast::hash(&mask));
        }
        Ok(Identity {
            made_by: format!("version {} on {}", VERSION, gpu.describe()),
            config: config.clone(),
            scene: sums,
        })
    }

    /// Refuses the checkpoint of another run; returns a warning where only the bits may differ.
    fn admit(&self, kept: &Identity) -> Result<Option<String>> {
        let keys = self.config.differences(&kept.config)?.into_iter();
        let keys: Vec<String> = keys
            .map(|Difference { key, here, there }| format!("`{key}` is {here}, was {there}"))
            .collect();
        refuse("config.json is not what it was", &keys)?;
        let names = self.scene.keys().chain(kept.scene.keys());
        let mut parts: Vec<String> = names
            .filter(|name| self.scene.get(*name) != kept.scene.get(*name))
            .cloned()
            .collect();
        parts.sort();
        parts.dedup();
        refuse("the scene is not what it was", &parts)?;
        Ok((self.made_by != kept.made_by).then(|| {
            format!(
                "the run was begun with {}; what follows may differ in its last bits",
                kept.made_by
            )
        }))
    }
}

fn refuse(what: &str, differing: &[String]) -> Result<()> {
    if differing.is_empty() {
        return Ok(());
    }
    let mut listed = differing[..differing.len().min(MAX_LISTED)].join(", ");
    if differing.len() > MAX_LISTED {
        listed += &format!(" and {} more", differing.len() - MAX_LISTED);
    }
    Err(Error::new(format!("{what}: {listed}"))
        .way_out("restore it, or train again with --overwrite"))
}

/// The header of a checkpoint: all that it holds beside the buffers.
#[derive(Serialize, Deserialize)]
struct Header<I = Identity, S = State> {
    identity: I,
    state: S,
    log: Log,
}

/// Notes of a training that go into `metrics.json`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Log {
    /// Training, with its checkpoints.
    pub(super) train_s: f64,
    /// Time spent on checkpoints.
    pub(super) keep_s: f64,
    pub(super) curve: Vec<CurvePoint>,
    /// Time spent on the curve.
    pub(super) curve_s: f64,
    /// Joules that processors took meanwhile; of no use in a run that is resumed.
    #[serde(skip)]
    pub(super) energy_j: Option<f64>,
}

/// Keeps a run's state: every so often, when a stop is asked for, and at the end, so that the
/// evaluation alone is to be repeated.
pub(super) struct Keeper<'a> {
    run: &'a RunDir,
    stop: &'a Stop,
    identity: Identity,
    every: Option<u32>,
    iterations: u32,
    last: Instant,
    cost: Duration,
}

impl<'a> Keeper<'a> {
    /// Prepares to keep the run every `every` iterations, or by time without it.
    pub(super) fn new(
        run: &'a RunDir,
        stop: &'a Stop,
        identity: Identity,
        every: Option<u32>,
        iterations: u32,
    ) -> Keeper<'a> {
        Keeper {
            run,
            stop,
            identity,
            every,
            iterations,
            last: Instant::now(),
            cost: Duration::ZERO,
        }
    }

    /// Takes `trainer` to the newest checkpoint of the run, where there is one; returns what had
    /// been noted.
    ///
    /// # Errors
    /// A checkpoint of another config or scene, or none that can be read.
    pub(super) fn resume(&mut self, trainer: &mut Trainer<'_>) -> Result<Log> {
        let store = self.run.checkpoints();
        store.tidy()?;
        let Some(found) = store.newest::<Header>()? else {
            return Ok(Log::default());
        };
        let Found {
            path,
            header,
            payload,
            warnings,
        } = found;
        let warning = self
            .identity
            .admit(&header.identity)
            .map_err(|e| e.at_path(&path))?;
        for warning in warnings.iter().chain(&warning) {
            log::warn!("{warning}");
        }
        let done = header.state.done;
        trainer
            .restore(header.state, &payload)
            .map_err(|e| e.at_path(&path))?;
        log::info!("going on after iteration {done} of {}", self.iterations);
        Ok(header.log)
    }

    /// Learns that the run has been decided to have so many iterations.
    pub(super) fn ends(&mut self, iterations: u32) {
        self.iterations = iterations;
    }

    pub(super) fn is_due(&self, done: u32) -> bool {
        let due = match self.every {
            Some(every) => done.is_multiple_of(every),
            None => self.last.elapsed() >= INTERVAL.max(COST_MULTIPLE * self.cost),
        };
        due || done == self.iterations || self.stop.asked()
    }

    /// Keeps the run as it is between two iterations: its state, buffers and log.
    ///
    /// # Errors
    /// A checkpoint that cannot be written, a GPU fault, or a stop that was asked for.
    pub(super) fn keep(
        &mut self,
        state: &State,
        buffers: impl Iterator<Item = Result<Vec<u8>>>,
        log: &mut Log,
    ) -> Result<()> {
        let start = Instant::now();
        let done = state.done;
        let header = Header {
            identity: &self.identity,
            state,
            log: log.clone(),
        };
        let saved = self.run.checkpoints().save(done, &header, buffers);
        saved.map_err(|e| e.or_way_out(self.way_back()))?;
        self.last = Instant::now();
        self.cost = self.last - start;
        log.keep_s += self.cost.as_secs_f64();
        if self.stop.asked() {
            let what = format!("after iteration {done} of {}", self.iterations);
            return Err(Error::of(ErrorKind::Interrupted, what).way_out(self.way_back()));
        }
        Ok(())
    }

    fn way_back(&self) -> String {
        format!(
            "go on with `gspotential train --resume {}`",
            self.run.root().display()
        )
    }
}
