//! This module finds photographs without cameras, decodes them and turns them upright as their EXIF
//! says.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use image::ImageDecoder;
use image::metadata::Orientation;

use super::Image;
use super::exif;
use super::image_file::{decoded, open_image};
use super::images::check_name;
use super::lookup::is_read;
use crate::error::{Error, Result};
use crate::files::read_file;

/// Levels within which all pixels of a photograph may lie that shows nothing.
const BLANK_LEVELS: u8 = 2;

/// A photograph that waits to be decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhotographFile {
    /// Its name in the scene: relative to the folder that was given, or the file's own.
    pub name: String,
    /// The file, as it is opened.
    pub path: PathBuf,
}

/// A decoded photograph, upright.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// The pixels, turned as the EXIF says.
    pub image: Image,
    /// Whether the pixels were turned: on disk they lie another way.
    pub turned: bool,
    /// Focal length on 35 mm film, mm, where the EXIF has it.
    pub focal_35mm: Option<f64>,
}

/// Finds the photographs that are named, in that order, and those of a folder by name.
///
/// # Errors
/// None at all, a path that is neither a file nor a folder, or two of one name.
pub fn find_photographs(paths: &[PathBuf]) -> Result<Vec<PhotographFile>> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let names = photographs_in(path)?;
            if names.is_empty() {
                let what = "holds no photograph (JPEG, PNG, WEBP or BMP)";
                return Err(Error::new(what).at_path(path));
            }
            let of = |name: String| PhotographFile {
                path: path.join(&name),
                name,
            };
            files.extend(names.into_iter().map(of));
            continue;
        }
        if !path.is_file() {
            return Err(Error::new("there is no such photograph").at_path(path));
        }
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        files.push(PhotographFile {
            name: name.unwrap_or_default(),
            path: path.clone(),
        });
    }
    let mut names = BTreeSet::new();
    for file in &files {
        check_name(&file.name)?;
        // The written scene has one file a name, also where the file system does not tell cases.
        if !names.insert(file.name.to_lowercase()) {
            return Err(
                Error::usage(format!("two photographs are named `{}`", file.name))
                    .way_out("rename one of them"),
            );
        }
    }
    if files.is_empty() {
        return Err(Error::usage("no photograph is named"));
    }
    Ok(files)
}

/// Decodes a photograph and turns it upright.
///
/// # Errors
/// A file that is unreadable, no PNG or JPEG, damaged or too large, or shows nothing.
pub fn read_photograph(path: &Path) -> Result<Photograph> {
    read(path).map_err(|e| e.at_path(path))
}

fn read(path: &Path) -> Result<Photograph> {
    let bytes = read_file(path)?;
    let (mut decoder, _) = open_image(&bytes)?;
    // Metadata that cannot be read says nothing, as if there were none.
    let exif = decoder.exif_metadata().ok().flatten();
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = decoded(&bytes, decoder)?;
    image.apply_orientation(orientation);
    let image = image.into_rgb8();
    let image = Image {
        width: image.width(),
        height: image.height(),
        rgb: image.into_raw(),
    };
    if is_blank(&image) {
        return Err(Error::new("every pixel is alike: it shows nothing")
            .way_out("leave the photograph out"));
    }
    Ok(Photograph {
        image,
        turned: orientation != Orientation::NoTransforms,
        focal_35mm: exif.and_then(|exif| exif::focal_35mm(&exif)),
    })
}

fn is_blank(image: &Image) -> bool {
    let (min, max) = image
        .rgb
        .chunks_exact(3)
        .fold(([255; 3], [0; 3]), |(min, max), pixel| {
            let channel = |c: usize| pixel[c];
            (
                [0, 1, 2].map(|c| channel(c).min(min[c])),
                [0, 1, 2].map(|c| channel(c).max(max[c])),
            )
        });
    min.iter()
        .zip(max)
        .all(|(min, max)| max.saturating_sub(*min) <= BLANK_LEVELS)
}

/// Names of the photographs in a folder, sorted; those of its subfolders are not looked for.
fn photographs_in(folder: &Path) -> Result<BTreeSet<String>> {
    let failed =
        |e: std::io::Error| Error::new(format!("cannot list the folder: {e}")).at_path(folder);
    let mut names = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if is_read(&name) && entry.path().is_file() {
            names.insert(name);
        }
    }
    Ok(names)
}
