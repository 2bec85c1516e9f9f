//! This module reads what is said of the photographs' depths and normals, in files of their names.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use exr::prelude::{ReadChannels, ReadLayers, read};
use glam::Vec3;
use image::DynamicImage;
use rayon::prelude::*;

use super::View;
use super::image_file::{MAX_SIDE, decoded, open_image, same_aspect};
use super::lookup::stem;
use crate::camera::Camera;
use crate::config::{Config, NormalAxes, PriorSource};
use crate::error::{Error, Result};
use crate::files::npy::read_array;
use crate::files::read_file;

/// Suffixes of files that are read, in the order in which they are looked for.
const SUFFIXES: [&str; 3] = ["npy", "exr", "png"];
/// Names of an EXR's channel of depths, or of one with anything else; the first that is there.
const DEPTH_CHANNELS: [&str; 5] = ["z", "depth", "y", "v", "r"];

/// What files say of a photograph, at its view's size, row 0 on top; one entry a pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Depths as the file has them, a PNG's times its step; not above 0 or not finite: there is none.
    pub depth: Option<Vec<f32>>,
    /// Weights of depths and normals.
    pub confidence: Option<Vec<f32>>,
    /// Unit normals in the camera's axes (x right, y down, z forward), on its side; 0: there is none.
    pub normal: Option<Vec<[f32; 3]>>,
}

impl Prior {
    /// Returns the bytes that it takes.
    pub fn bytes(&self) -> usize {
        let numbers = [&self.depth, &self.confidence].into_iter().flatten();
        let normals = self.normal.as_deref().map_or(0, size_of_val);
        numbers
            .map(|values| size_of_val(&values[..]))
            .sum::<usize>()
            + normals
    }
}

/// The files that are wanted of every training view.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorFiles {
    depths: bool,
    normals: bool,
    /// Depth of a level of a PNG.
    png_step: f64,
    axes: NormalAxes,
}

impl PriorFiles {
    /// Returns what `config` wants, `None` for nothing.
    pub fn of(config: &Config) -> Option<PriorFiles> {
        let prior = &config.prior;
        let wanted = prior.is_on() && prior.source == PriorSource::Files;
        wanted.then(|| PriorFiles {
            depths: prior.has_depths(),
            normals: prior.has_normals(),
            png_step: prior.png_step,
            axes: prior.normal_axes,
        })
    }
}

/// Reads the files of all training views; `distorted` says which photographs are not as they were taken.
///
/// # Errors
/// A file that is missing, unreadable or of another shape than the photograph; a distorted photograph.
pub(super) fn read_priors(
    scene: &Path,
    views: &mut [View],
    distorted: &[bool],
    wanted: &PriorFiles,
) -> Result<()> {
    let read = |(view, distorted): (&View, &bool)| read_prior(scene, view, *distorted, wanted);
    let priors: Vec<Result<Prior>> = views.par_iter().zip(distorted).map(read).collect();
    for (view, prior) in views.iter_mut().zip(priors) {
        view.prior = Some(prior?);
    }
    Ok(())
}

fn read_prior(scene: &Path, view: &View, distorted: bool, wanted: &PriorFiles) -> Result<Prior> {
    let camera = &view.camera;
    if distorted {
        return Err(Error::new(format!(
            "the photograph `{}` is undistorted while it is loaded, but depths and normals are not",
            camera.name.escape_debug()
        ))
        .way_out(
            "undistort the scene first (COLMAP's image_undistorter), or train without files",
        ));
    }
    let found = |folder: &str, kind: Kind| -> Result<Option<Map>> {
        let path = find(&scene.join(folder), &camera.name);
        let map = path.map(|path| {
            let map = kind.read(&path, wanted.png_step);
            map.and_then(|map| map.fitted(camera))
                .map_err(|e| e.at_path(&path))
        });
        map.transpose()
    };
    let needed = |folder: &str, kind: Kind, key: &str| {
        found(folder, kind)?.ok_or_else(|| {
            let name = camera.name.escape_debug();
            Error::new(format!("no file for the photograph `{name}`, as `{}.npy`", stem(&camera.name)))
                .at_path(&scene.join(folder))
                .way_out(format!(
                    "give a .npy, .exr or .png file of each training view's name, or `--set prior.{key}=0`"
                ))
        })
    };
    let depth = || needed("depths", Kind::Depth, "weight").map(|map| map.values);
    let normal = || needed("normals", Kind::Normal, "normal_weight");
    let confidence = found("confidences", Kind::Share)?.map(|map| map.values);
    Ok(Prior {
        depth: wanted.depths.then(depth).transpose()?,
        confidence,
        normal: match wanted.normals {
            true => Some(unit_normals(&normal()?, camera, wanted.axes)),
            false => None,
        },
    })
}

/// Finds the file of the photograph `name` (`left/a.jpg`): `left/a.jpg.npy`, or else `left/a.npy`.
fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let names = [name, stem(name)];
    let paths = names
        .iter()
        .flat_map(|name| SUFFIXES.map(|suffix| folder.join(format!("{name}.{suffix}"))));
    paths.into_iter().find(|path| path.is_file())
}

/// What a file's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Depth,
    /// A PNG's levels are 0 to 1.
    Share,
    /// Three numbers a pixel; a PNG's levels are -1 to 1.
    Normal,
}

/// Numbers of the pixels of an image, row by row.
struct Map {
    width: usize,
    height: usize,
    /// Side by side, one or three a pixel.
    values: Vec<f32>,
}

impl Kind {
    fn channels(self) -> usize {
        if self == Kind::Normal { 3 } else { 1 }
    }

    fn read(self, path: &Path, png_step: f64) -> Result<Map> {
        let bytes = read_file(path)?;
        let suffix = path.extension().and_then(|suffix| suffix.to_str());
        match suffix {
            Some("npy") => self.of_npy(&bytes),
            Some("exr") => self.of_exr(&bytes),
            _ => self.of_png(&bytes, png_step),
        }
    }

    fn of_npy(self, bytes: &[u8]) -> Result<Map> {
        let (shape, values) = read_array(bytes)?;
        let n = self.channels();
        let (size, planes) = match (n, &shape[..]) {
            (1, [height, width] | [height, width, 1] | [1, height, width]) => {
                ([*width, *height], false)
            }
            (3, [height, width, 3]) => ([*width, *height], false),
            (3, [3, height, width]) => ([*width, *height], true),
            _ => {
                return Err(
                    Error::new(format!("an array of shape {shape:?} is no image")).way_out(
                        format!("save one of shape (height, width{})", ["", ", 3"][n / 3]),
                    ),
                );
            }
        };
        let [width, height] = size;
        let values = match planes {
            false => values,
            true => {
                let plane = width * height;
                (0..3 * plane)
                    .map(|i| values[i % 3 * plane + i / 3])
                    .collect()
            }
        };
        Map::new(size, values)
    }

    fn of_exr(self, bytes: &[u8]) -> Result<Map> {
        let broken = |e: exr::error::Error| Error::new(format!("cannot decode the EXR image: {e}"));
        let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false);
        for header in &meta.map_err(broken)?.headers {
            let size = header.layer_size;
            if size.0 > MAX_SIDE as usize || size.1 > MAX_SIDE as usize {
                return Err(
                    Error::new(format!("the image is {}x{} pixels", size.0, size.1))
                        .way_out(format!("scale it down to {MAX_SIDE} pixels a side")),
                );
            }
        }
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .map_err(broken)?;
        let layer = &image.layer_data;
        let channels = &layer.channel_data.list;
        // `depth.Z` is Z of a layer.
        let last = |name: String| name.rsplit('.').next().unwrap_or_default().to_lowercase();
        let named: Vec<String> = channels.iter().map(|c| last(c.name.to_string())).collect();
        let at = |name: &&str| named.iter().position(|n| n == name);
        let found: Option<Vec<usize>> = match self {
            Kind::Normal => [["r", "g", "b"], ["x", "y", "z"]]
                .iter()
                .find_map(|names| names.iter().map(&at).collect()),
            _ if named.len() == 1 => Some(vec![0]),
            _ => DEPTH_CHANNELS.iter().find_map(at).map(|i| vec![i]),
        };
        let found = found.ok_or_else(|| {
            Error::new(format!(
                "the EXR image has the channels {}",
                named.join(", ")
            ))
            .way_out("name them R, G, B for normals, or Z for depths")
        })?;
        let planes: Vec<Vec<f32>> = found
            .iter()
            .map(|i| channels[*i].sample_data.values_as_f32().collect())
            .collect();
        let n = planes.iter().map(Vec::len).min().unwrap_or(0);
        let values = (0..n).flat_map(|i| planes.iter().map(move |plane| plane[i]));
        Map::new([layer.size.0, layer.size.1], values.collect())
    }

    fn of_png(self, bytes: &[u8], png_step: f64) -> Result<Map> {
        let (decoder, (width, height)) = open_image(bytes)?;
        let image = decoded(bytes, decoder)?;
        let scale = match self {
            Kind::Depth => png_step,
            Kind::Share => 1.0 / 65_535.0,
            Kind::Normal => 2.0 / 65_535.0,
        };
        let values: Vec<f32> = match (self, &image) {
            (Kind::Normal, _) => {
                let levels = image.to_rgb16().into_raw().into_iter();
                levels
                    .map(|v| (f64::from(v) * scale - 1.0) as f32)
                    .collect()
            }
            (Kind::Depth, DynamicImage::ImageLuma8(levels)) => levels
                .iter()
                .map(|v| (f64::from(*v) * scale) as f32)
                .collect(),
            (_, DynamicImage::ImageLuma8(_) | DynamicImage::ImageLuma16(_)) => {
                let levels = image.to_luma16().into_raw().into_iter();
                levels.map(|v| (f64::from(v) * scale) as f32).collect()
            }
            _ => {
                return Err(Error::new("the image has colours")
                    .way_out("save it as a grey PNG of 16 bits, or as .npy or .exr"));
            }
        };
        Map::new([width as usize, height as usize], values)
    }
}

impl Map {
    fn new([width, height]: [usize; 2], values: Vec<f32>) -> Result<Map> {
        let n = width.checked_mul(height);
        let is_whole = n.is_some_and(|n| n > 0 && (values.len() == n || values.len() == 3 * n));
        if !is_whole {
            return Err(Error::new(format!(
                "{width}x{height} pixels, but {} numbers",
                values.len()
            )));
        }
        Ok(Map {
            width,
            height,
            values,
        })
    }

    /// Returns the map at the size of `camera`: each pixel has what is nearest, as between two surfaces
    /// there is no depth.
    fn fitted(self, camera: &Camera) -> Result<Map> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let own = (self.width as u32, self.height as u32);
        if !same_aspect((camera.width, camera.height), own) {
            return Err(Error::new(format!(
                "{}x{} pixels, but the photograph is used at {width}x{height}",
                self.width, self.height
            ))
            .way_out("give it the photograph's shape, at any resolution"));
        }
        let n = self.values.len() / (self.width * self.height);
        let nearest = |i: usize, to: usize, from: usize| (2 * i + 1) * from / (2 * to);
        let mut values = Vec::with_capacity(n * width * height);
        for y in 0..height {
            let row = nearest(y, height, self.height) * self.width;
            for x in 0..width {
                let at = row + nearest(x, width, self.width);
                values.extend_from_slice(&self.values[n * at..][..n]);
            }
        }
        Ok(Map {
            width,
            height,
            values,
        })
    }
}

/// Returns unit normals in the camera's axes, on its side; 0 where there is none.
fn unit_normals(map: &Map, camera: &Camera, axes: NormalAxes) -> Vec<[f32; 3]> {
    let normals = map.values.as_chunks().0.iter().enumerate();
    let normal = |(i, values): (usize, &[f32; 3])| {
        let given = Vec3::from_array(*values);
        let turned = match axes {
            NormalAxes::Opencv => given,
            NormalAxes::Opengl => given * Vec3::new(1.0, -1.0, -1.0),
        };
        let (x, y) = (i % map.width, i / map.width);
        let ray = Vec3::new(
            ((x as f64 + 0.5 - camera.cx) / camera.fx) as f32,
            ((y as f64 + 0.5 - camera.cy) / camera.fy) as f32,
            1.0,
        );
        let unit = turned.try_normalize().unwrap_or(Vec3::ZERO);
        let side = if unit.dot(ray) > 0.0 { -1.0 } else { 1.0 };
        (side * unit).to_array()
    };
    normals.map(normal).collect()
}
