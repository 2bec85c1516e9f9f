//! This module tells the formats that Gaussians are exported in by a file's ending.

use std::path::Path;

use super::gltf::write_gltf;
use super::ply::{Stored, write_stored};
use super::splat::write_splat;
use super::spz::write_spz;
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
    /// glTF with the extension for Gaussians.
    Gltf,
}

/// Every ending with its format.
const ENDINGS: [(&str, Format); 5] = [
    ("ply", Format::Ply),
    ("spz", Format::Spz),
    ("splat", Format::Splat),
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
            Format::Gltf => write_gltf(path, gaussians, warnings),
        }
    }
}
