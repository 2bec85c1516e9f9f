//! This module tells the formats that Gaussians are exported in by a file's ending.

use std::path::Path;

use super::Gaussians;
use super::gltf::write_gltf;
use super::ply::{Stored, read_ply, write_stored};
use super::sog::{read_sog, write_sog};
use super::splat::{read_splat, write_splat};
use super::spz::{moved, read_spz, write_spz};
use crate::camera::Similarity;
use crate::error::{Error, Result};

/// A format that Gaussians are exported in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// The layout of 3DGS.
    Ply,
    /// Niantic's, compressed.
    Spz,
    /// 32 bytes a Gaussian.
    Splat,
    /// The compact one of `PlayCanvas`.
    Sog,
    /// glTF with the extension for Gaussians.
    Gltf,
}

/// Every ending with its format.
const ENDINGS: [(&str, Format); 6] = [
    ("ply", Format::Ply),
    ("spz", Format::Spz),
    ("splat", Format::Splat),
    ("sog", Format::Sog),
    ("glb", Format::Gltf),
    ("gltf", Format::Gltf),
];

impl Format {
    /// Returns the format that a file's ending names.
    ///
    /// # Errors
    /// It names none: lists those there are.
    pub fn of(path: &Path) -> Result<Format> {
        let ending = path.extension().and_then(|ext| ext.to_str());
        let found = ENDINGS.iter().find(|(name, _)| Some(*name) == ending);
        found.map(|(_, format)| *format).ok_or_else(|| {
            let known: Vec<String> = ENDINGS.iter().map(|(name, _)| format!(".{name}")).collect();
            Error::usage(format!(
                "the formats to export Gaussians in are {}",
                known.join(", ")
            ))
            .at_path(path)
            .way_out("name a file that ends in one of them")
        })
    }

    /// Returns whether a file has a place for what is taken out of its positions.
    pub fn has_offset(self) -> bool {
        self == Format::Ply
    }

    /// Returns whether a file's axes say which way is up.
    pub fn has_up(self) -> bool {
        self == Format::Gltf
    }

    /// Writes Gaussians in the frame that they are in; returns how many. What becomes of what the
    /// format cannot hold as it is goes to `warnings`. A `lean` PLY has only the properties that
    /// say something.
    ///
    /// # Errors
    /// What keeps the file from being written.
    pub fn write(
        self,
        path: &Path,
        stored: &Stored,
        lean: bool,
        warnings: &mut Vec<String>,
    ) -> Result<usize> {
        let gaussians = &stored.gaussians;
        match self {
            Format::Ply => write_stored(path, stored, lean).map(|()| gaussians.len()),
            Format::Spz => write_spz(path, gaussians, warnings),
            Format::Splat => write_splat(path, gaussians, warnings),
            Format::Sog => write_sog(path, gaussians, warnings),
            Format::Gltf => write_gltf(path, gaussians, warnings),
        }
    }

    /// Reads what [`Format::write`] has made of `written`, in the frame that this is in; `None` for a
    /// format that has every number in f32 and no reader here.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read_back(self, path: &Path, written: &Stored) -> Result<Option<Gaussians>> {
        let read = match self {
            Format::Ply => read_ply(path)?.gaussians,
            Format::Spz => {
                let moved = moved(&written.gaussians);
                let back = Similarity {
                    scale: 1.0 / moved.scale,
                    translation: -moved.translation / moved.scale,
                    ..moved
                };
                read_spz(path)?.placed(&back)
            }
            Format::Splat => read_splat(path)?,
            Format::Sog => read_sog(path)?,
            Format::Gltf => return Ok(None),
        };
        Ok(Some(read))
    }
}
