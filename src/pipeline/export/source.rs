//! This module reads what is exported, and what a run's cameras say of it.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::super::posed::{frame_of_cameras, named};
use super::cost::{Renders, costs};
use super::mesh::{Seen, surface};
use super::size::{Distance, Size, check_length};
use crate::camera::compass::Compass;
use crate::camera::json::read_cameras;
use crate::camera::{Camera, Frame, Similarity};
use crate::config::ModelConfig;
use crate::error::{Error, Result};
use crate::gaussians::Format;
use crate::gaussians::ply::{Stored, read_ply};
use crate::mesh::Mesh;
use crate::report::Table;
use crate::run::RunDir;

/// Near plane of 3DGS's own viewer and of those made after it, in the file's unit.
const VIEWER_NEAR: f64 = 0.2;

/// Lengths are multiplied by less than this, and divided, so that positions in f32 stay finite.
const MOST_FACTOR: f64 = 1e12;

/// What is exported.
pub(super) struct Source {
    /// The path that the command names.
    model: PathBuf,
    pub stored: Stored,
    /// Cameras and near plane, if it is a run.
    run: Option<Posed>,
}

/// A run's cameras, in the scene's own frame.
pub(super) struct Posed {
    all: Vec<Camera>,
    train: Vec<Camera>,
    test: Vec<Camera>,
    /// `None` where the training cameras span none.
    frame: Option<Frame>,
    config: ModelConfig,
}

impl Source {
    pub(super) fn read(model: &Path) -> Result<Source> {
        let run = match model.is_dir() {
            true => Some(RunDir::open(model)?),
            false => None,
        };
        let ply = match &run {
            Some(run) => run.point_cloud(),
            None => model.to_owned(),
        };
        let stored = read_ply(&ply)?;
        if stored.gaussians.heaviest(1).is_empty() {
            return Err(Error::new(format!(
                "none of the {} Gaussians is ever drawn, so there is nothing to export",
                stored.gaussians.len()
            ))
            .at_path(&ply)
            .way_out("train the scene again, or name another model"));
        }
        Ok(Source {
            model: model.to_owned(),
            stored,
            run: run.map(|run| Posed::of(&run)).transpose()?,
        })
    }

    /// Returns the run's cameras.
    pub(super) fn cameras(&self) -> Result<&[Camera]> {
        self.posed("--cameras").map(|posed| posed.all.as_slice())
    }

    /// Returns what is known of a run; `option` is what asks for it.
    pub(super) fn posed(&self, option: &str) -> Result<&Posed> {
        self.run.as_ref().ok_or_else(|| {
            Error::usage(format!(
                "{option} needs the cameras of a run, and this is only its model"
            ))
            .at_path(&self.model)
            .way_out("name the run's directory")
        })
    }

    /// Makes the surface mesh, in the scene's own frame.
    pub(super) fn mesh(&self, voxels: u32) -> Result<Mesh> {
        let posed = self.posed("--mesh")?;
        let frame = posed.frame.ok_or_else(|| {
            Error::new("the run's training cameras do not say where the scene is")
                .at_path(&self.model)
                .way_out("a mesh needs two training views or more that look at one place")
        })?;
        let is_virtual = |camera: &&Camera| camera.name.starts_with("virtual_");
        let others: Vec<Camera> = posed.all.iter().filter(is_virtual).cloned().collect();
        let seen = Seen {
            gaussians: &self.stored.clone().to_canonical(&frame),
            train: &posed.train,
            others: &others,
            frame,
            config: &posed.config,
        };
        surface(&seen, voxels).map_err(|e| e.at_path(&self.model))
    }

    /// Measures the files that were written of `written`, whose lengths are `factor` times the
    /// model's.
    pub(super) fn costs(
        &self,
        files: &[(&Path, Format)],
        written: &Stored,
        factor: f64,
    ) -> Result<Table> {
        let posed = self.posed("--measure")?;
        let views: Vec<Camera> = posed.train.iter().chain(&posed.test).cloned().collect();
        let (Some(frame), false) = (posed.frame, views.is_empty()) else {
            return Err(Error::new("the run has no view to measure at").at_path(&self.model));
        };
        let renders = Renders {
            views: &views,
            frame,
            config: &posed.config,
        };
        costs(&renders, &self.stored, files, written, factor)
    }

    /// Finds how many of the file's units are one of the scene's.
    pub(super) fn factor(&self, size: &Size) -> Result<f64> {
        let factor = match size {
            Size::AsItIs => {
                self.note_near();
                return Ok(1.0);
            }
            Size::Factor(factor) => {
                check_length(*factor, "--scale")?;
                *factor
            }
            Size::Metres(distance) => self.metres(distance)?,
            Size::ViewerSafe => {
                let near = self.posed("--viewer-safe")?.near_plane().ok_or_else(|| {
                    Error::new("the run's training cameras do not say how large the scene is")
                        .at_path(&self.model)
                        .way_out("give a factor with --scale")
                })?;
                (VIEWER_NEAR / near).log2().ceil().exp2().max(1.0)
            }
        };
        if !(1.0 / MOST_FACTOR..=MOST_FACTOR).contains(&factor) {
            return Err(Error::usage(format!(
                "lengths would be multiplied by {factor:e}, which no file of f32 holds"
            ))
            .at_path(&self.model)
            .way_out("check the unit that is asked for"));
        }
        log::info!("lengths are {factor} times the scene's");
        Ok(factor)
    }

    fn metres(&self, distance: &Distance) -> Result<f64> {
        let all = &self.posed("--metres")?.all;
        let views = named(&distance.views, all).map_err(|e| e.at("--metres"))?;
        let apart = views[0].center().distance(views[1].center());
        // Centres far from the origin are rounded.
        let least = 1e-9 * views[0].center().length();
        if apart > least {
            return Ok(distance.metres / apart);
        }
        let [a, b] = &distance.views;
        Err(Error::usage(format!(
            "`{a}` and `{b}` were taken at one place, so no distance lies between them"
        ))
        .at("--metres")
        .way_out("name two views with some way between them"))
    }

    /// Says so where viewers would cut off much of what is seen.
    fn note_near(&self) {
        let Some(near) = self.run.as_ref().and_then(Posed::near_plane) else {
            return;
        };
        if near < VIEWER_NEAR / 4.0 {
            log::info!(
                "viewers with a near plane of {VIEWER_NEAR}, as 3DGS's own has, cut off what is \
                 nearer; the run's cameras see from {near:.1e} on: --viewer-safe makes the scene large \
                 enough"
            );
        }
    }

    /// Returns the rotation after which y points up and z from the scene to where the first
    /// training camera stands; without cameras 3DGS's usual axes, y down and z forward, are taken.
    pub(super) fn upright(&self) -> Result<Similarity> {
        let half_turn = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let posed = self.run.as_ref().and_then(|run| Some((run, run.frame?)));
        let rotation = match posed {
            None => half_turn,
            Some((run, frame)) => {
                let compass = Compass::of_cameras(&run.train, frame.center)?;
                let turned = |axis: DVec3| {
                    let [front, right, up] = compass.local(axis).to_array();
                    DVec3::new(right, up, front)
                };
                DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z))
            }
        };
        Ok(Similarity {
            rotation,
            ..Similarity::IDENTITY
        })
    }
}

impl Posed {
    fn of(run: &RunDir) -> Result<Posed> {
        let all = read_cameras(&run.cameras())?;
        let of = |names: &[String]| named(names, &all).map_err(|e| e.at_path(&run.cameras()));
        let (train, test) = match run.is_finished() {
            true => {
                let scene = run.metrics()?.scene;
                (of(&scene.train_views)?, of(&scene.test_views)?)
            }
            false => (Vec::new(), Vec::new()),
        };
        Ok(Posed {
            frame: frame_of_cameras(&train),
            config: run.config()?.model,
            all,
            train,
            test,
        })
    }

    /// Returns the distance from which on the run's cameras see, in the scene's unit.
    fn near_plane(&self) -> Option<f64> {
        self.frame.map(|frame| self.config.near * frame.extent)
    }
}
