//! A mask says which pixels of a photograph show the subject.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use image::imageops::{FilterType, resize};
use image::{DynamicImage, GrayImage, RgbImage};

use super::image_file::{decoded, open_image, same_aspect};
use super::lookup::stem;
use super::window::{THRESHOLD, Window};
use super::{Mask, Outside};
use crate::config::OutsideMask;
use crate::error::{Error, Result};
use crate::files::read_file;

/// An alpha channel that leaves out, or one that keeps, no more than this share of the pixels is no
/// mask: editors and resizers leave such pixels behind, and failed segmentations.
const MIN_SHARE: f64 = 1e-3;
/// A photograph that is more transparent than this throughout is a veil over the background;
/// rounding and dithering of an opaque one stay below.
const MAX_VEIL: f64 = 0.01;

/// A scene's folder of masks, `masks/`.
pub(super) struct Masks(Option<PathBuf>);

impl Masks {
    pub(crate) fn of(scene: &Path) -> Masks {
        let dir = scene.join("masks");
        Masks(dir.is_dir().then_some(dir))
    }

    /// Finds the mask's file of the photograph `name` (`left/a.jpg`): `left/a.jpg.png`, as COLMAP
    /// names them, or else `left/a.png`.
    pub(crate) fn file(&self, name: &str) -> Option<PathBuf> {
        let dir = self.0.as_ref()?;
        let names = [format!("{name}.png"), format!("{}.png", stem(name))];
        names
            .iter()
            .map(|name| dir.join(name))
            .find(|path| path.is_file())
    }

    /// Returns a line for the log if there is the folder, but not a mask for every view.
    pub(crate) fn missing<'a>(&self, views: impl Iterator<Item = &'a str>) -> Option<String> {
        self.0.as_ref()?;
        let views: BTreeSet<&str> = views.collect();
        let without: Vec<&&str> = views.iter().filter(|v| self.file(v).is_none()).collect();
        without.first().map(|first| {
            format!(
                "{} of {} views have no mask in `masks/` (`{}.png`{})",
                without.len(),
                views.len(),
                first.escape_debug(),
                if without.len() > 1 { ", ..." } else { "" }
            )
        })
    }
}

/// Reads the mask of a photograph of `photograph` pixels, at the size of its own.
///
/// # Errors
/// A file that is unreadable or no image, of another shape than the photograph, or that is
/// neither black and white nor grey in between, as one that numbers its labels.
fn read_mask(path: &Path, photograph: (u32, u32)) -> Result<GrayImage> {
    let decode = || {
        let bytes = read_file(path)?;
        let (decoder, size) = open_image(&bytes)?;
        if !same_aspect(photograph, size) {
            return Err(Error::new(format!(
                "the mask is {}x{} pixels but its photograph {}x{}",
                size.0, size.1, photograph.0, photograph.1
            ))
            .way_out("draw it on the photograph, or scale it without changing its shape"));
        }
        let levels = decoded(&bytes, decoder)?.into_luma8();
        let brightest = levels.pixels().map(|p| p.0[0]).max().unwrap_or(0);
        if brightest == 0 {
            return Err(
                Error::new("the mask has nothing inside: all of it is black")
                    .way_out("draw it again, or remove it to use the whole photograph"),
            );
        }
        if (1..THRESHOLD).contains(&brightest) {
            return Err(Error::new(format!(
                "the mask's brightest pixel is {brightest} of 255, so none would be set"
            ))
            .way_out("save it with the subject white and the rest black"));
        }
        Ok(levels)
    };
    decode().map_err(|e| e.at_path(path))
}

/// The alpha channel of a photograph, judged.
enum Alpha {
    /// There is none, or all of it is opaque.
    None,
    Mask(GrayImage),
    /// It says nothing of a subject: why.
    Unusable(Unbelieved),
}

/// The reason for which an alpha channel is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Unbelieved {
    /// It leaves next to nothing out.
    AlmostOpaque,
    /// It keeps next to nothing.
    AlmostEmpty,
}

impl Unbelieved {
    /// Returns a line for the log about `names`, at least one.
    pub(crate) fn line(self, names: &[String]) -> String {
        let (what, why) = match self {
            Unbelieved::AlmostOpaque => (
                "leave next to nothing out",
                "the whole photographs are used",
            ),
            Unbelieved::AlmostEmpty => (
                "have nothing inside",
                "they are not believed and the whole photographs are used: cut out the subject again",
            ),
        };
        format!(
            "the alpha channels of {} photographs {what} (`{}`{}): {why}",
            names.len(),
            names[0].escape_debug(),
            if names.len() > 1 { ", ..." } else { "" }
        )
    }
}

/// Tells what the alpha channel of a photograph is.
fn alpha_mask(photograph: &DynamicImage) -> Alpha {
    if !photograph.color().has_alpha() {
        return Alpha::None;
    }
    let (width, height) = (photograph.width(), photograph.height());
    let alpha: Vec<u8> = photograph.to_rgba8().pixels().map(|p| p.0[3]).collect();
    if alpha.iter().all(|&a| a == 255) {
        return Alpha::None;
    }
    let n = alpha.len() as f64;
    let few = MIN_SHARE * n;
    // In whole pixels: a veil over all of the photograph leaves something out, too.
    let kept = alpha.iter().map(|&a| f64::from(a)).sum::<f64>() / 255.0;
    let n_out = alpha.iter().filter(|&&a| a < THRESHOLD).count() as f64;
    if n_out <= few && n - kept <= MAX_VEIL * n {
        return Alpha::Unusable(Unbelieved::AlmostOpaque);
    }
    if kept <= few {
        return Alpha::Unusable(Unbelieved::AlmostEmpty);
    }
    GrayImage::from_raw(width, height, alpha).map_or(Alpha::None, Alpha::Mask)
}

/// A mask as it is read: how bright or opaque, 0 to 255.
pub(super) struct Levels {
    pub levels: GrayImage,
    pub outside: Outside,
    /// The window that an alpha channel may be whose use nobody has chosen.
    pub window: Option<Option<Window>>,
}

/// The meaning of an alpha channel that nobody has chosen one for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum AlphaIs {
    /// What it leaves out is the background of a subject.
    CutOut,
    /// What it leaves out was not photographed.
    Window,
}

impl Levels {
    /// Reads the mask in the file `path` or else the photograph's alpha channel, at any size; what
    /// it leaves out is as `wanted`, which leaves what an alpha channel says to `alpha`. Beside it
    /// why an alpha channel is none.
    ///
    /// # Errors
    /// What [`read_mask`] refuses.
    pub(crate) fn of(
        path: Option<PathBuf>,
        photograph: &DynamicImage,
        wanted: OutsideMask,
        alpha: AlphaIs,
    ) -> Result<(Option<Levels>, Option<Unbelieved>)> {
        let mut window = None;
        let (levels, auto) = match path {
            Some(path) => {
                let size = (photograph.width(), photograph.height());
                (read_mask(&path, size)?, Outside::Ignored)
            }
            None => match alpha_mask(photograph) {
                Alpha::Mask(levels) => {
                    window = (wanted == OutsideMask::Auto).then(|| Window::of(&levels));
                    match alpha {
                        AlphaIs::CutOut => (levels, Outside::Background),
                        AlphaIs::Window => (levels, Outside::Ignored),
                    }
                }
                Alpha::None => return Ok((None, None)),
                Alpha::Unusable(why) => return Ok((None, Some(why))),
            },
        };
        let outside = match wanted {
            OutsideMask::Auto => auto,
            OutsideMask::Ignored => Outside::Ignored,
            OutsideMask::Background => Outside::Background,
            OutsideMask::Kept => Outside::Kept,
        };
        let levels = Levels {
            levels,
            outside,
            window,
        };
        Ok((Some(levels), None))
    }

    /// Puts the `background`, RGB in [0, 1], behind the photograph where the mask asks for it.
    pub(crate) fn cut_out(&self, photograph: &mut RgbImage, background: [f64; 3]) {
        if self.outside != Outside::Background {
            return;
        }
        let background = background.map(|c| (255.0 * c).round() as u32);
        let levels = scaled(&self.levels, photograph.dimensions());
        for (pixel, level) in photograph.pixels_mut().zip(levels.pixels()) {
            let alpha = u32::from(level.0[0]);
            for (value, behind) in pixel.0.iter_mut().zip(background) {
                let blend = alpha * u32::from(*value) + (255 - alpha) * behind;
                *value = ((blend + 127) / 255) as u8;
            }
        }
    }

    /// Returns whether each pixel at the size `target` is at least half bright or opaque.
    pub(crate) fn mask(&self, target: (u32, u32)) -> Mask {
        let levels = scaled(&self.levels, target);
        Mask {
            set: levels.pixels().map(|p| p.0[0] >= THRESHOLD).collect(),
            outside: self.outside,
        }
    }
}

fn scaled(levels: &GrayImage, target: (u32, u32)) -> Cow<'_, GrayImage> {
    if levels.dimensions() == target {
        return Cow::Borrowed(levels);
    }
    // A triangle filter does not overshoot, so a thin part does not make others of its own.
    Cow::Owned(resize(levels, target.0, target.1, FilterType::Triangle))
}
