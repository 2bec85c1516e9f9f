//! This module takes a trained model elsewhere: to the formats of other programs, in a unit that is
//! asked for.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::{DMat3, DVec3};

use super::mesh::{Seen, surface};
use super::posed::{frame_of_cameras, named};
use crate::camera::compass::Compass;
use crate::camera::json::{read_cameras, write_cameras};
use crate::camera::{Camera, Frame, Similarity};
use crate::config::ModelConfig;
use crate::error::{Error, Result};
use crate::gaussians::Format;
use crate::gaussians::ply::{Stored, read_ply};
use crate::mesh::{Mesh, MeshFormat};
use crate::run::RunDir;

/// Near plane of 3DGS's own viewer and of those made after it, in the file's unit.
const VIEWER_NEAR: f64 = 0.2;

/// A request to `export`.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportJob {
    /// A run's directory, or Gaussians in the 3DGS PLY layout.
    pub model: PathBuf,
    /// Files to write; their endings name their formats.
    pub out: Vec<PathBuf>,
    /// The unit that they are written in.
    pub size: Size,
    /// Whether a PLY leaves out properties that say nothing.
    pub lean: bool,
    /// File for the run's cameras, in the same unit.
    pub cameras: Option<PathBuf>,
    /// Voxels along the longest side of the grid of a surface mesh, which is written in place of the
    /// Gaussians.
    pub mesh: Option<u32>,
}

/// The unit of what is exported.
#[derive(Clone, Debug, PartialEq)]
pub enum Size {
    /// The scene's own.
    AsItIs,
    /// So many new units are one of the scene's.
    Factor(f64),
    /// Metres, by a distance that is known.
    Metres(Distance),
    /// The scene's own times the power of 2 from which viewers with a near plane of 0.2 show all
    /// that the run's cameras see.
    ViewerSafe,
}

/// A distance between the centres of two views that someone has measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Distance {
    /// The views' names.
    pub views: [String; 2],
    /// Metres between them.
    pub metres: f64,
}

impl FromStr for Distance {
    type Err = Error;

    /// Reads `VIEW:VIEW=LENGTH`.
    fn from_str(text: &str) -> Result<Distance> {
        let parts = text
            .rsplit_once('=')
            .and_then(|(views, length)| Some((views.split_once(':')?, length.parse().ok()?)));
        let Some(((a, b), metres)) = parts else {
            return Err(Error::usage("this is no distance between two views")
                .way_out("write VIEW:VIEW=LENGTH, as in a.jpg:b.jpg=1.35"));
        };
        check_length(metres, "the distance")?;
        Ok(Distance {
            views: [a, b].map(str::to_owned),
            metres,
        })
    }
}

/// Refuses a length or factor that is none.
fn check_length(value: f64, what: &str) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::usage(format!(
        "{what} is {value}, but must be above 0 and finite"
    )))
}

/// Lengths are multiplied by less than this, and divided, so that positions in f32 stay finite.
const MOST_FACTOR: f64 = 1e12;

/// Exports a model.
///
/// # Errors
/// A format that is none, a model or run that cannot be read, a unit that its cameras do not give,
/// or what keeps a file from being written.
pub fn export(job: &ExportJob) -> Result<()> {
    let formats = Formats::of(job)?;
    let source = Source::read(&job.model)?;
    let factor = source.factor(&job.size)?;
    let scaled = Similarity {
        scale: factor,
        ..Similarity::IDENTITY
    };
    let offset = factor * source.stored.offset;
    match formats {
        Formats::Mesh(formats, voxels) => {
            let mesh = source.mesh(voxels)?.placed(&scaled);
            for (path, format) in job.out.iter().zip(formats) {
                write_mesh(path, format, &mesh, offset, &source)?;
            }
        }
        Formats::Gaussians(formats) => {
            let gaussians = source.stored.gaussians.clone().placed(&scaled);
            let stored = Stored { gaussians, offset };
            for (path, format) in job.out.iter().zip(formats) {
                write(path, format, &stored, job.lean, &source)?;
            }
        }
    }
    if let Some(path) = &job.cameras {
        let cameras: Vec<Camera> = source.cameras()?.iter().map(|c| scaled.camera(c)).collect();
        write_cameras(path, &cameras, offset)?;
        log::info!("wrote {} cameras to {}", cameras.len(), path.display());
    }
    Ok(())
}

/// The formats of the files, and what they hold.
enum Formats {
    Gaussians(Vec<Format>),
    Mesh(Vec<MeshFormat>, u32),
}

impl Formats {
    /// Finds them before anything takes time.
    fn of(job: &ExportJob) -> Result<Formats> {
        if let Some(voxels) = job.mesh {
            if job.lean {
                return Err(Error::usage("--lean is for Gaussians, and a mesh is written"));
            }
            let formats = job.out.iter().map(|path| MeshFormat::of(path));
            return Ok(Formats::Mesh(formats.collect::<Result<_>>()?, voxels));
        }
        let formats = job.out.iter().map(|path| {
            Format::of(path).map_err(|e| match MeshFormat::of(path) {
                Ok(_) => Error::usage("the format holds no Gaussians")
                    .at_path(path)
                    .way_out("add --mesh for a surface mesh"),
                Err(_) => e,
            })
        });
        let formats: Vec<Format> = formats.collect::<Result<_>>()?;
        if job.lean && !formats.contains(&Format::Ply) {
            return Err(Error::usage("--lean is for .ply files, and none is written"));
        }
        Ok(Formats::Gaussians(formats))
    }
}

/// Writes a mesh and says how large it is.
fn write_mesh(
    path: &Path,
    format: MeshFormat,
    mesh: &Mesh,
    offset: DVec3,
    source: &Source,
) -> Result<()> {
    match format.has_up() {
        true => {
            let apart = Similarity {
                translation: -offset,
                ..Similarity::IDENTITY
            };
            let mesh = mesh.clone().placed(&apart).placed(&source.upright()?);
            format.write(path, &mesh, DVec3::ZERO)?;
        }
        false => format.write(path, mesh, offset)?,
    }
    if format != MeshFormat::Ply {
        warn_of_offset(path, offset);
    }
    log::info!(
        "wrote {} triangles of {} vertices to {}",
        mesh.triangles.len(),
        mesh.positions.len(),
        path.display()
    );
    Ok(())
}

/// Says so where a format has no place for the offset.
fn warn_of_offset(path: &Path, offset: DVec3) {
    if offset != DVec3::ZERO {
        log::warn!(
            "{}: positions are without the model's offset {} {} {}, which the format has no place for",
            path.display(),
            offset.x,
            offset.y,
            offset.z
        );
    }
}

/// Writes one file and says what it holds, and what it does not.
fn write(path: &Path, format: Format, stored: &Stored, lean: bool, source: &Source) -> Result<()> {
    let mut warnings = Vec::new();
    let upright;
    let stored = match format.has_up() {
        true => {
            upright = Stored {
                gaussians: stored.gaussians.clone().placed(&source.upright()?),
                offset: stored.offset,
            };
            &upright
        }
        false => stored,
    };
    let n = format.write(path, stored, lean, &mut warnings)?;
    for warning in &warnings {
        log::warn!("{}: {warning}", path.display());
    }
    if !format.has_offset() {
        warn_of_offset(path, stored.offset);
    }
    log::info!("wrote {n} Gaussians to {}", path.display());
    if n < stored.gaussians.len() {
        log::info!("{} others are never drawn", stored.gaussians.len() - n);
    }
    Ok(())
}

/// What is exported.
struct Source {
    /// The path that the command names.
    model: PathBuf,
    stored: Stored,
    /// Cameras and near plane, if it is a run.
    run: Option<Posed>,
}

/// A run's cameras, in the scene's own frame.
struct Posed {
    all: Vec<Camera>,
    train: Vec<Camera>,
    /// `None` where the training cameras span none.
    frame: Option<Frame>,
    config: ModelConfig,
}

impl Source {
    fn read(model: &Path) -> Result<Source> {
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
    fn cameras(&self) -> Result<&[Camera]> {
        self.posed("--cameras").map(|posed| posed.all.as_slice())
    }

    fn posed(&self, option: &str) -> Result<&Posed> {
        self.run.as_ref().ok_or_else(|| {
            Error::usage(format!(
                "{option} needs the cameras of a run, and this is only its model"
            ))
            .at_path(&self.model)
            .way_out("name the run's directory")
        })
    }

    /// Makes the surface mesh, in the scene's own frame.
    fn mesh(&self, voxels: u32) -> Result<Mesh> {
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

    /// Finds how many of the file's units are one of the scene's.
    fn factor(&self, size: &Size) -> Result<f64> {
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
    fn upright(&self) -> Result<Similarity> {
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
        let train = match run.is_finished() {
            true => named(&run.metrics()?.scene.train_views, &all)
                .map_err(|e| e.at_path(&run.cameras()))?,
            false => Vec::new(),
        };
        Ok(Posed {
            frame: frame_of_cameras(&train),
            config: run.config()?.model,
            all,
            train,
        })
    }

    /// Returns the distance from which on the run's cameras see, in the scene's unit.
    fn near_plane(&self) -> Option<f64> {
        self.frame.map(|frame| self.config.near * frame.extent)
    }
}
