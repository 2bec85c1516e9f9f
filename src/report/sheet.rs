//! A contact sheet shows many pictures on one page of bounded size.

use image::imageops::{FilterType, resize};
use image::{ImageBuffer, Rgb};

use crate::error::{Error, Result};
use crate::scene::Image;

/// Bound of a sheet's sides, pixels.
const MAX_SIDE: u32 = 4000;
/// Gap between the pictures of a group, and between groups, pixels.
const GUTTER: u32 = 2;
const GROUP_GUTTER: u32 = 8;
/// Grey of the gaps: apart from black masks and from white ones.
const GUTTER_COLOR: u8 = 64;

/// A grid of groups of pictures; a group stands side by side, as a render beside its photograph.
///
/// Pictures are scaled down as they come, so a sheet of hundreds needs the memory of one.
#[derive(Debug)]
pub struct ContactSheet {
    page: Image,
    layout: Layout,
    n_groups: usize,
    n_placed: usize,
}

#[derive(Clone, Copy, Debug)]
struct Layout {
    columns: u32,
    rows: u32,
    group_len: u32,
    cell_width: u32,
    cell_height: u32,
}

impl Layout {
    fn group_width(&self) -> u32 {
        self.group_len * (self.cell_width + GUTTER) - GUTTER
    }

    fn page_width(&self) -> u32 {
        self.columns * (self.group_width() + GROUP_GUTTER) + GROUP_GUTTER
    }

    fn page_height(&self) -> u32 {
        self.rows * (self.cell_height + GROUP_GUTTER) + GROUP_GUTTER
    }

    /// Finds the grid of `n_groups` that shows pictures of `width x height` largest.
    fn new(n_groups: u32, group_len: u32, width: u32, height: u32) -> Option<Layout> {
        let fits = |columns: u32| {
            let rows = n_groups.div_ceil(columns);
            let gaps = columns * (group_len - 1) * GUTTER + (columns + 1) * GROUP_GUTTER;
            let free_width = MAX_SIDE.checked_sub(gaps)?;
            let free_height = MAX_SIDE.checked_sub((rows + 1) * GROUP_GUTTER)?;
            let scale = (f64::from(free_width) / (f64::from(columns * group_len * width)))
                .min(f64::from(free_height) / (f64::from(rows) * f64::from(height)))
                .min(1.0);
            let side = |length: u32| (f64::from(length) * scale) as u32;
            let (cell_width, cell_height) = (side(width), side(height));
            (cell_width > 0 && cell_height > 0).then_some(Layout {
                columns,
                rows,
                group_len,
                cell_width,
                cell_height,
            })
        };
        // Larger pictures first, then the page that is nearest to a square.
        (1..=n_groups).filter_map(fits).max_by_key(|layout| {
            let (width, height) = (layout.page_width(), layout.page_height());
            (layout.cell_width, std::cmp::Reverse(width.max(height)))
        })
    }
}

impl ContactSheet {
    /// Starts a sheet for `n_groups` groups of `group_len` pictures of about `width x height`
    /// pixels.
    pub fn new(n_groups: usize, group_len: usize, width: u32, height: u32) -> Result<ContactSheet> {
        // Beyond these a cell would be less than a pixel; they also keep the products in u32.
        let bounded = (1..=100_000).contains(&n_groups)
            && (1..=16).contains(&group_len)
            && (1..=65_535).contains(&width)
            && (1..=65_535).contains(&height);
        let layout = bounded
            .then(|| Layout::new(n_groups as u32, group_len as u32, width, height))
            .flatten()
            .ok_or_else(|| {
                Error::new(format!(
                    "{n_groups} groups of {group_len} pictures of {width}x{height} fit no contact sheet"
                ))
            })?;
        let (page_width, page_height) = (layout.page_width(), layout.page_height());
        Ok(ContactSheet {
            page: Image {
                width: page_width,
                height: page_height,
                rgb: vec![GUTTER_COLOR; (page_width * page_height * 3) as usize],
            },
            layout,
            n_groups,
            n_placed: 0,
        })
    }

    /// Places the next group: row by row, from the left. Pictures of another shape than the
    /// sheet's are centred in their cells, never enlarged.
    pub fn add(&mut self, group: &[&Image]) -> Result<()> {
        let layout = self.layout;
        if self.n_placed == self.n_groups || group.len() != layout.group_len as usize {
            return Err(Error::new(format!(
                "group {} of {} pictures does not belong on a contact sheet of {} groups of {}",
                self.n_placed + 1,
                group.len(),
                self.n_groups,
                layout.group_len
            )));
        }
        let place = self.n_placed as u32;
        let left = GROUP_GUTTER + place % layout.columns * (layout.group_width() + GROUP_GUTTER);
        let top = GROUP_GUTTER + place / layout.columns * (layout.cell_height + GROUP_GUTTER);
        for (i, picture) in group.iter().enumerate() {
            let small = shrunk(picture, layout.cell_width, layout.cell_height)?;
            let x = left
                + i as u32 * (layout.cell_width + GUTTER)
                + (layout.cell_width - small.width()) / 2;
            let y = top + (layout.cell_height - small.height()) / 2;
            for (row, pixels) in small
                .as_raw()
                .chunks_exact(small.width() as usize * 3)
                .enumerate()
            {
                let start = ((y as usize + row) * self.page.width as usize + x as usize) * 3;
                self.page.rgb[start..start + pixels.len()].copy_from_slice(pixels);
            }
        }
        self.n_placed += 1;
        Ok(())
    }

    /// Returns the page; places that were never filled stay grey.
    pub fn finish(self) -> Image {
        self.page
    }
}

/// Scales the picture down to fit and keeps its shape, by a triangle filter as wide as the
/// reduction.
pub(super) fn shrunk(
    picture: &Image,
    width: u32,
    height: u32,
) -> Result<ImageBuffer<Rgb<u8>, Vec<u8>>> {
    let Some(pixels) =
        ImageBuffer::<Rgb<u8>, &[u8]>::from_raw(picture.width, picture.height, &picture.rgb)
            .filter(|pixels| pixels.width() > 0 && pixels.height() > 0)
    else {
        return Err(Error::new(format!(
            "a picture of {}x{} has {} bytes",
            picture.width,
            picture.height,
            picture.rgb.len()
        )));
    };
    let scale = (f64::from(width) / f64::from(picture.width))
        .min(f64::from(height) / f64::from(picture.height))
        .min(1.0);
    let side =
        |length: u32, limit: u32| ((f64::from(length) * scale).round() as u32).clamp(1, limit);
    Ok(resize(
        &pixels,
        side(picture.width, width),
        side(picture.height, height),
        FilterType::Triangle,
    ))
}

/// Draws a mask (`height * width`) as a picture: grey from black, 0, to white, 255.
pub fn mask_image(width: u32, height: u32, mask: &[u8]) -> Image {
    Image {
        width,
        height,
        rgb: mask.iter().flat_map(|&weight| [weight; 3]).collect(),
    }
}
