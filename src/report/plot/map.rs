//! A map shows values over the sphere flat, with marked directions.

use std::ops::Range;
use std::path::Path;

use glam::DVec3;
use plotters::prelude::*;

use super::{BAR_WIDTH, ColorScale, FONT};
use crate::camera::compass::Compass;
use crate::error::{Error, Result};
use crate::files::write_file;

/// Cells around the equator; half as many from pole to pole.
const N_LONGITUDES: i32 = 120;

/// Pixels a cell.
const CELL: i32 = 6;

/// Directions marked on a map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapMark {
    /// Name in the legend.
    pub name: String,
    /// Unit vectors from the map's centre.
    pub directions: Vec<DVec3>,
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Radius, pixels.
    pub size_px: u32,
}

/// Values over the unit sphere, azimuth to the right and elevation up (equirectangular).
pub struct SphereMap<'a> {
    /// The text above the map.
    pub title: String,
    /// Label of the scale of colours, with its unit.
    pub color_label: String,
    /// Value in a unit direction; what is not finite is left blank.
    pub value: &'a dyn Fn(DVec3) -> f64,
    /// Least and greatest of the colours, for maps that are looked at together; otherwise those of
    /// the values.
    pub range: Option<Range<f64>>,
    /// Up is at the top of the map, the front in its middle.
    pub compass: Compass,
    /// Drawn over the map in this order.
    pub marks: Vec<MapMark>,
}

impl SphereMap<'_> {
    /// Draws the map as a document of its own.
    ///
    /// # Errors
    /// No value is finite.
    pub fn to_svg(&self) -> Result<String> {
        let grid = self.compass.grid(N_LONGITUDES as usize / 2);
        let cells: Vec<f64> = grid.into_iter().map(self.value).collect();
        let Some(own) = ColorScale::over(cells.iter().copied()) else {
            return Err(Error::new("the map has no finite value").at(&self.title));
        };
        let scale = self.range.clone().map_or(own, ColorScale);
        let mut svg = String::new();
        self.draw(&mut svg, &cells, &scale)
            .map_err(|e| Error::new(format!("cannot draw: {e}")).at(&self.title))?;
        Ok(svg)
    }

    /// Writes the map as an SVG file.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_file(path, self.to_svg()?.as_bytes())
    }

    fn draw(
        &self,
        svg: &mut String,
        cells: &[f64],
        scale: &ColorScale,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let (left, top) = (48, 40);
        let (width, height) = (N_LONGITUDES * CELL, N_LONGITUDES / 2 * CELL);
        let size = (
            (left + width) as u32 + 16 + BAR_WIDTH,
            (top + height) as u32 + 78,
        );
        let root = SVGBackend::with_string(svg, size).into_drawing_area();
        root.fill(&WHITE)?;
        root.draw(&Text::new(self.title.clone(), (left, 12), (FONT, 22)))?;
        for (row, values) in cells.chunks(N_LONGITUDES as usize).enumerate() {
            let color = |value: &f64| match value.is_finite() {
                true => scale.color(*value),
                false => WHITE,
            };
            let colors: Vec<RGBColor> = values.iter().map(color).collect();
            let mut x = left;
            for same in colors.chunk_by(|a, b| a == b) {
                // One pixel more to the right and below, which the next ones cover: edges that
                // only touch shine through.
                let end = x + same.len() as i32 * CELL;
                let y = top + row as i32 * CELL;
                let corners = [
                    (x, y),
                    (
                        (end + 1).min(left + width),
                        (y + CELL + 1).min(top + height),
                    ),
                ];
                root.draw(&Rectangle::new(corners, same[0].filled()))?;
                x = end;
            }
        }
        for degrees in (-180..=180).step_by(60) {
            let x = left + width * (degrees + 180) / 360;
            let text = format!("{degrees}");
            root.draw(&Text::new(text, (x - 10, top + height + 6), (FONT, 15)))?;
        }
        for degrees in (-90..=90).step_by(30) {
            let y = top + height * (90 - degrees) / 180;
            root.draw(&Text::new(
                format!("{degrees:>3}"),
                (left - 30, y - 6),
                (FONT, 15),
            ))?;
        }
        let caption = "azimuth across and elevation upwards, degrees about the focus";
        root.draw(&Text::new(caption, (left, top + height + 24), (FONT, 16)))?;
        let mut x = left;
        for mark in &self.marks {
            let [r, g, b] = mark.color;
            let color = RGBColor(r, g, b);
            for d in &mark.directions {
                let (azimuth, elevation) = self.compass.angles(*d);
                let place = (
                    left + (f64::from(width) * (azimuth + 180.0) / 360.0) as i32,
                    top + (f64::from(height) * (90.0 - elevation) / 180.0) as i32,
                );
                root.draw(&Circle::new(place, mark.size_px + 1, BLACK.filled()))?;
                root.draw(&Circle::new(place, mark.size_px, color.filled()))?;
            }
            let y = top + height + 54;
            root.draw(&Circle::new((x + 5, y), 5, BLACK.filled()))?;
            root.draw(&Circle::new((x + 5, y), 4, color.filled()))?;
            let text = format!("{} ({})", mark.name, mark.directions.len());
            x += 30 + 7 * text.chars().count() as i32;
            root.draw(&Text::new(
                text.clone(),
                (x - 14 - 7 * text.chars().count() as i32, y - 6),
                (FONT, 16),
            ))?;
        }
        let (_, bar) = root.split_horizontally(size.0 - BAR_WIDTH);
        scale.draw(&bar, &self.color_label)?;
        root.present()?;
        Ok(())
    }
}
