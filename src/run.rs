//! The run directory: one training run's config, model, pictures and figures.
//!
//! ```text
//! config.json      the resolved config
//! metrics.json     what training did (Metrics)
//! eval.json        errors at the test views (Evaluation)
//! point_cloud.ply  the Gaussians
//! cameras.json     every camera
//! virtual/         contact_sheet.png: virtual views beside their masks
//! test/            one PNG a test view; contact_sheet.png: renders beside photographs
//! ```

mod evaluation;
mod names;
mod record;

pub use evaluation::{
    Evaluation, LpipsRecord, MaskedMean, MaskedScore, Mean, Measured, PointSplatScore, Renders,
    ViewScore, mean,
};
pub use names::file_names;
pub use record::{
    ImageLoss, LossSample, Memory, Metrics, ModelSize, PlanCounts, PoseProtocol, SceneRecord,
    Seconds, peak_host_bytes,
};

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::config::Config;
use crate::error::{Error, Result, create_dir, read_file, write_file};

/// Beside `config.json`.
const FILES: &[&str] = &[
    "metrics.json",
    "eval.json",
    "point_cloud.ply",
    "cameras.json",
];
/// In both folders; [`file_names`] gives it to no view.
const SHEET: &str = "contact_sheet.png";
const FOLDERS: &[&str] = &["virtual", "test"];

/// A run directory that exists.
#[derive(Clone, Debug)]
pub struct RunDir {
    root: PathBuf,
}

impl RunDir {
    /// `runs/<scene>-<preset>-seed<seed>`.
    pub fn default_path(scene: &str, config: &Config) -> PathBuf {
        Path::new("runs").join(format!("{scene}-{}-seed{}", config.preset, config.seed))
    }

    /// Fails where [`RunDir::create`] would because of what is there already; for an early
    /// refusal, before the scene is loaded.
    pub fn check(root: &Path, overwrite: bool) -> Result<()> {
        if is_vacant(root)? {
            return Ok(());
        }
        if !overwrite {
            return Err(Error::new("is not empty")
                .at_path(root)
                .way_out("choose another --out, or replace the run with --overwrite"));
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

    /// Creates the directory with its folders and writes `config.json`, so that an output that
    /// cannot be written fails before training. With `overwrite` an older run's files are
    /// removed first; what else lies there stays.
    pub fn create(root: &Path, config: &Config, overwrite: bool) -> Result<RunDir> {
        Self::check(root, overwrite)?;
        let run = RunDir {
            root: root.to_owned(),
        };
        create_dir(root)?;
        // First of all: what is left of an interrupted start is then known as a run.
        write_file(&run.config_file(), config.to_json()?.as_bytes())?;
        for name in FILES {
            remove(&run.root.join(name), |path| std::fs::remove_file(path))?;
        }
        for name in FOLDERS {
            let folder = run.root.join(name);
            remove(&folder, |path| std::fs::remove_dir_all(path))?;
            create_dir(&folder)?;
        }
        Ok(run)
    }

    /// An existing run, recognised by its `config.json`.
    pub fn open(root: &Path) -> Result<RunDir> {
        if !root.join("config.json").is_file() {
            return Err(Error::new("is no run directory: it has no config.json")
                .at_path(root)
                .way_out("name a directory that `gspotential train` wrote"));
        }
        Ok(RunDir {
            root: root.to_owned(),
        })
    }

    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Short name for tables: the directory's own.
    pub fn name(&self) -> String {
        match self.root.file_name() {
            Some(name) => name.to_string_lossy().into_owned(),
            None => self.root.display().to_string(),
        }
    }

    pub fn point_cloud(&self) -> PathBuf {
        self.root.join("point_cloud.ply")
    }

    pub fn cameras(&self) -> PathBuf {
        self.root.join("cameras.json")
    }

    /// Contact sheet of the virtual views and their masks.
    pub fn virtual_sheet(&self) -> PathBuf {
        self.root.join("virtual").join(SHEET)
    }

    /// Contact sheet of the test views, each render beside its photograph.
    pub fn test_sheet(&self) -> PathBuf {
        self.root.join("test").join(SHEET)
    }

    /// Folder for the renders of the test views, which [`file_names`] names.
    pub fn test_views(&self) -> PathBuf {
        self.root.join("test")
    }

    /// The file of the resolved config that the run was trained with.
    pub fn config_file(&self) -> PathBuf {
        self.root.join("config.json")
    }

    /// The resolved config that the run was trained with.
    pub fn config(&self) -> Result<Config> {
        Config::from_file(&self.config_file())
    }

    pub fn write_metrics(&self, metrics: &Metrics) -> Result<()> {
        self.write_json("metrics.json", metrics)
    }

    pub fn metrics(&self) -> Result<Metrics> {
        self.read_json("metrics.json")
    }

    pub fn write_evaluation(&self, evaluation: &Evaluation) -> Result<()> {
        self.write_json("eval.json", evaluation)
    }

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

/// Absent or an empty directory.
fn is_vacant(root: &Path) -> Result<bool> {
    match std::fs::read_dir(root) {
        Ok(mut entries) => Ok(entries.next().is_none()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(true),
        Err(e) => Err(Error::new(format!("cannot be a run directory: {e}")).at_path(root)),
    }
}

/// Older versions' configs count, too, so only the outline is looked at.
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
