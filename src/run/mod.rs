//! The run directory holds one training run's config, model, pictures and figures.
//!
//! ```text
//! config.json      the resolved config
//! metrics.json     what training did (Metrics)
//! eval.json        errors at the test views (Evaluation)
//! point_cloud.ply  the Gaussians
//! cameras.json     every camera
//! virtual/         contact_sheet.png: virtual views beside their masks
//! report.html      all of it to look at, in one file
//! profile.json     where its time went, where that was asked for (RunProfile)
//! test/            one PNG a test view; contact_sheet.png: renders beside photographs
//! checkpoints/     until the run is finished: its job, and states to resume from
//! .lock            locked by the process that writes the run
//! ```

mod checkpoints;
mod energy;
mod evaluation;
mod lock;
mod names;
mod profile;
mod record;
mod stop;

pub use checkpoints::{Checkpoints, Found};
pub use energy::{COUNTERS, EnergyMeter};
pub use evaluation::{Evaluation, Measured};
pub use names::file_names;
pub use profile::{KernelProfile, RunProfile, Sample, StepProfile};
pub use record::{
    CurvePoint, JobRecord, Memory, Metrics, ModelSize, PoseChange, SceneRecord, Seconds,
    VirtualImages,
};
pub use stop::{Gentle, Stop};

pub use crate::files::peak_host_bytes;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde::de::DeserializeOwned;

use lock::{LOCK_FILE, RunLock};

use crate::config::Config;
use crate::error::{Error, Result};
use crate::files::{create_dir, read_file, write_file};

/// Beside `config.json`.
const FILES: &[&str] = &[
    "metrics.json",
    "eval.json",
    "point_cloud.ply",
    "cameras.json",
    "report.html",
    "profile.json",
];
/// In both folders; [`file_names`] gives it to no view.
const SHEET: &str = "contact_sheet.png";
const FOLDERS: &[&str] = &["virtual", "test"];
const CHECKPOINTS: &str = "checkpoints";
const JOB: &str = "checkpoints/job.json";

/// A run directory that exists.
#[derive(Clone, Debug)]
pub struct RunDir {
    root: PathBuf,
    /// The lock of a run that this process writes.
    lock: Option<Arc<RunLock>>,
    /// Place of its scene, if that is not where it was.
    scene: Option<PathBuf>,
}

impl RunDir {
    /// Returns `runs/<scene>-<preset>-seed<seed>`.
    pub fn default_path(scene: &str, config: &Config) -> PathBuf {
        Path::new("runs").join(format!("{scene}-{}-seed{}", config.preset, config.seed))
    }

    /// Fails where [`RunDir::create`] would because of what is there already; for an early
    /// refusal, before the scene is loaded.
    pub fn check(root: &Path, overwrite: bool) -> Result<()> {
        check_contents(root, overwrite)?;
        if root.join(LOCK_FILE).exists() {
            RunLock::take(root)?;
        }
        Ok(())
    }

    /// Creates the directory with its folders, locks it and writes `config.json`, so that an
    /// output that cannot be written fails before training. With `overwrite` an older run's files
    /// are removed first; what else lies there stays.
    pub fn create(root: &Path, config: &Config, overwrite: bool) -> Result<RunDir> {
        check_contents(root, overwrite)?;
        create_dir(root)?;
        let lock = RunLock::take(root)?;
        // Another process may have come first.
        check_contents(root, overwrite)?;
        let run = RunDir {
            root: root.to_owned(),
            lock: Some(Arc::new(lock)),
            scene: None,
        };
        // What is left of an interrupted start is always known as a run, for its config, and never
        // as a finished one.
        for name in FILES {
            remove(&run.root.join(name), |path| std::fs::remove_file(path))?;
        }
        run.checkpoints().clear()?;
        run.write_config(config)?;
        for name in FOLDERS {
            let folder = run.root.join(name);
            remove(&folder, |path| std::fs::remove_dir_all(path))?;
            create_dir(&folder)?;
        }
        Ok(run)
    }

    /// Opens an existing run to read, recognised by its `config.json`.
    pub fn open(root: &Path) -> Result<RunDir> {
        if !root.join("config.json").is_file() {
            return Err(Error::new("is not a run directory: it has no config.json")
                .at_path(root)
                .way_out("name a directory that `gspotential train` wrote"));
        }
        Ok(RunDir {
            root: root.to_owned(),
            lock: None,
            scene: None,
        })
    }

    /// Does what [`RunDir::open`] does, to write, too: no other process can until this is dropped.
    pub fn claim(root: &Path) -> Result<RunDir> {
        let run = Self::open(root)?;
        Ok(RunDir {
            lock: Some(Arc::new(RunLock::take(root)?)),
            ..run
        })
    }

    /// Returns this run to write, too; it is locked by this value or by the result.
    pub fn claimed(&self) -> Result<RunDir> {
        match self.lock {
            Some(_) => Ok(self.clone()),
            None => Ok(RunDir {
                scene: self.scene.clone(),
                ..Self::claim(&self.root)?
            }),
        }
    }

    /// Returns this run with its scene in the folder `dir`, where it has moved since:
    /// [`RunDir::metrics`] names it, and a cloud beside it, there.
    pub fn with_scene_in(self, dir: &Path) -> RunDir {
        RunDir {
            scene: Some(dir.to_owned()),
            ..self
        }
    }

    /// Returns whether the scene is looked for in another folder than it was trained on.
    pub fn has_moved_scene(&self) -> bool {
        self.scene.is_some()
    }

    /// Returns whether training and evaluation have ended; `metrics.json` is written last.
    pub fn is_finished(&self) -> bool {
        self.root.join("metrics.json").is_file()
    }

    /// Returns the checkpoints of this run, in its `checkpoints/`.
    pub fn checkpoints(&self) -> Checkpoints {
        Checkpoints::new(self.root.join(CHECKPOINTS))
    }

    /// Notes what the run is asked for, so that it can be resumed.
    pub fn write_job(&self, job: &JobRecord) -> Result<()> {
        create_dir(self.checkpoints().folder())?;
        self.write_json(JOB, job)
    }

    /// Reads what an unfinished run was asked for.
    pub fn job(&self) -> Result<JobRecord> {
        if !self.root.join(JOB).is_file() {
            return Err(Error::new("was stopped before its training began")
                .at_path(&self.root)
                .way_out("start it again, with --overwrite"));
        }
        self.read_json(JOB)
    }

    /// Returns the run directory.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the short name for tables: the directory's own.
    pub fn name(&self) -> String {
        match self.root.file_name() {
            Some(name) => name.to_string_lossy().into_owned(),
            None => self.root.display().to_string(),
        }
    }

    /// Returns the path of the trained Gaussians, which a run without a finished training lacks.
    pub fn point_cloud(&self) -> PathBuf {
        self.root.join("point_cloud.ply")
    }

    /// Returns the path of the cameras: training, test and virtual views.
    pub fn cameras(&self) -> PathBuf {
        self.root.join("cameras.json")
    }

    /// Returns the path of the contact sheet of the virtual views and their masks.
    pub fn virtual_sheet(&self) -> PathBuf {
        self.root.join("virtual").join(SHEET)
    }

    /// Returns the path of the contact sheet of the test views, each render beside its photograph.
    pub fn test_sheet(&self) -> PathBuf {
        self.root.join("test").join(SHEET)
    }

    /// Returns the folder for the renders of the test views, which [`file_names`] names.
    pub fn test_views(&self) -> PathBuf {
        self.root.join("test")
    }

    /// Returns the path of the run's page.
    pub fn report(&self) -> PathBuf {
        self.root.join("report.html")
    }

    /// Returns the path of the resolved config that the run was trained with.
    pub fn config_file(&self) -> PathBuf {
        self.root.join("config.json")
    }

    /// Writes the resolved config, once it is known what was measured for it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write_config(&self, config: &Config) -> Result<()> {
        write_file(&self.config_file(), config.to_json()?.as_bytes())
    }

    /// Reads the resolved config that the run was trained with.
    pub fn config(&self) -> Result<Config> {
        Config::from_file(&self.config_file())
    }

    /// Writes `metrics.json`, last of all: from then on the run counts as finished.
    pub fn write_metrics(&self, metrics: &Metrics) -> Result<()> {
        self.write_json("metrics.json", metrics)
    }

    /// Reads `metrics.json`. A scene that has moved is named where it is now.
    ///
    /// # Errors
    /// The run is not finished, or the file is not as this version writes it.
    pub fn metrics(&self) -> Result<Metrics> {
        if !self.is_finished() {
            let root = self.root.display();
            return Err(Error::new("is missing: the run is not finished")
                .at_path(&self.root.join("metrics.json"))
                .way_out(format!("go on with `gspotential train --resume {root}`")));
        }
        let mut metrics: Metrics = self.read_json("metrics.json")?;
        if let Some(dir) = &self.scene {
            metrics.scene.moved_to(dir);
        }
        Ok(metrics)
    }

    /// Writes `profile.json`.
    pub fn write_profile(&self, profile: &RunProfile) -> Result<()> {
        self.write_json("profile.json", profile)
    }

    /// Reads `profile.json`.
    ///
    /// # Errors
    /// The run was not profiled, or the file is not as this version writes it.
    pub fn profile(&self) -> Result<RunProfile> {
        self.read_json("profile.json")
    }

    /// Writes `eval.json`.
    pub fn write_evaluation(&self, evaluation: &Evaluation) -> Result<()> {
        self.write_json("eval.json", evaluation)
    }

    /// Reads `eval.json`; a PSNR of an identical image, null in the file, is infinite again.
    ///
    /// # Errors
    /// The run was not evaluated, or the file is not as this version writes it.
    pub fn evaluation(&self) -> Result<Evaluation> {
        let evaluation: Evaluation = self.read_json("eval.json")?;
        Ok(evaluation.with_infinities())
    }

    fn write_json(&self, name: &str, value: &impl Serialize) -> Result<()> {
        let path = self.root.join(name);
        let text = serde_json::to_string_pretty(value)
            .map_err(|e| Error::new(e.to_string()).at_path(&path))?;
        write_file(&path, (text + "\n").as_bytes())
    }

    fn read_json<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let path = self.root.join(name);
        serde_json::from_slice(&read_file(&path)?).map_err(|e| {
            Error::new(format!("not as this version writes it: {e}"))
                .at_path(&path)
                .way_out("train the run again")
        })
    }
}

fn check_contents(root: &Path, overwrite: bool) -> Result<()> {
    if is_vacant(root)? {
        return Ok(());
    }
    if !overwrite {
        return Err(Error::new("is not empty").at_path(root).way_out(
            "choose another --out, go on with a run that was stopped with --resume, or replace it \
             with --overwrite",
        ));
    }
    // Whoever mistypes --out must not lose a `test/` folder of their own.
    if !is_run(root) {
        return Err(
            Error::new("is not empty and holds no run, so it is not overwritten")
                .at_path(root)
                .way_out("choose another --out"),
        );
    }
    Ok(())
}

/// Returns whether a path is absent, or a directory with nothing in it but perhaps a lock.
fn is_vacant(root: &Path) -> Result<bool> {
    match std::fs::read_dir(root) {
        Ok(mut entries) => {
            Ok(entries.all(|entry| entry.is_ok_and(|entry| entry.file_name() == LOCK_FILE)))
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(true),
        Err(e) => Err(Error::new(format!("cannot be a run directory: {e}")).at_path(root)),
    }
}

/// Returns whether a directory holds a run. Older versions' configs count, too, so only the outline
/// is looked at.
fn is_run(root: &Path) -> bool {
    read_file(&root.join("config.json"))
        .ok()
        .and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok())
        .is_some_and(|config| config["preset"].is_string() && config["iterations"].is_u64())
}

fn remove(path: &Path, remove: impl Fn(&Path) -> std::io::Result<()>) -> Result<()> {
    match remove(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::new(format!("cannot remove: {e}")).at_path(path))
        }
        _ => Ok(()),
    }
}
