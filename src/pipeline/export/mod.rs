//! This module takes a trained model elsewhere: to the formats of other programs, in a unit that is
//! asked for.

mod cost;
mod mesh;
mod size;
mod source;

pub use size::{Distance, Size};

use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::camera::json::write_cameras;
use crate::camera::{Camera, Similarity};
use crate::error::{Error, Result};
use crate::gaussians::Format;
use crate::gaussians::ply::Stored;
use crate::mesh::{Mesh, MeshFormat};
use crate::report::Table;
use source::Source;

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
    /// Whether it is measured what each format costs, at the run's training and test views.
    pub measure: bool,
    /// Voxels along the longest side of the grid of a surface mesh, which is written in place of the
    /// Gaussians.
    pub mesh: Option<u32>,
}

/// Exports a model; returns what the formats cost, where that is asked for.
///
/// # Errors
/// A format that is none, a model or run that cannot be read, a unit that its cameras do not give,
/// or what keeps a file from being written.
pub fn export(job: &ExportJob) -> Result<Option<Table>> {
    let formats = Formats::of(job)?;
    let source = Source::read(&job.model)?;
    // Before anything is written.
    if job.cameras.is_some() {
        source.cameras()?;
    }
    if job.measure {
        source.posed("--measure")?;
    }
    let factor = source.factor(&job.size)?;
    let scaled = Similarity {
        scale: factor,
        ..Similarity::IDENTITY
    };
    let offset = factor * source.stored.offset;
    let mut table = None;
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
            for (path, format) in job.out.iter().zip(&formats) {
                write(path, *format, &stored, job.lean, &source)?;
            }
            if job.measure {
                let files = job.out.iter().map(PathBuf::as_path).zip(formats);
                table = Some(source.costs(&files.collect::<Vec<_>>(), &stored, factor)?);
            }
        }
    }
    if let Some(path) = &job.cameras {
        let cameras: Vec<Camera> = source.cameras()?.iter().map(|c| scaled.camera(c)).collect();
        write_cameras(path, &cameras, offset)?;
        log::info!("wrote {} cameras to {}", cameras.len(), path.display());
    }
    Ok(table)
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
            if job.lean || job.measure {
                return Err(Error::usage(
                    "--lean and --measure are for Gaussians, and a mesh is written",
                ));
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
            return Err(Error::usage(
                "--lean is for .ply files, and none is written",
            ));
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
