//! A flat map of values over the sphere, with marked directions.

use std::path::Path;

use glam::DVec3;
use plotters::prelude::*;

use super::{BAR_WIDTH, ColorScale, FONT};
use crate::error::{Error, Result, write_file};

/// Cells around the equator; half as many from pole to pole.
const N_LONGITUDES: i32 = 120;

/// Pixels a cell.
const CELL: i32 = 6;

/// Directions marked on a map.
#[derive(Clone, Debug, PartialEq)]
pub struct MapMark {
    /// For the legend.
    pub name: String,
    pub directions: Vec<DVec3>,
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Radius, pixels.
    pub size_px: u32,
}

/// Values over the unit sphere, longitude to the right and latitude up (equirectangular).
pub struct SphereMap<'a> {
    pub title: String,
    /// What the colours say, with its unit.
    pub color_label: String,
    /// Value in a unit direction.
    pub value: &'a dyn Fn(DVec3) -> f64,
    /// The unit direction at the top of the map.
    pub up: DVec3,
    pub marks: Vec<MapMark>,
}

impl SphereMap<'_> {
    /// The map as a document of its own.
    ///
    /// # Errors
    /// `up` has no direction, or no value is finite.
    pub fn to_svg(&self) -> Result<String> {
        let Some(up) = self.up.try_normalize() else {
            return Err(Error::new("the map has no upward direction").at(&self.title));
        };
        let right = up.any_orthonormal_vector();
        let axes = [right, up.cross(right), up];
        let n_latitudes = N_LONGITUDES / 2;
        let cells: Vec<f64> = (0..n_latitudes)
            .flat_map(|row| (0..N_LONGITUDES).map(move |column| (row, column)))
            .map(|(row, column)| (self.value)(direction(axes, row, column)))
            .collect();
        let Some(scale) = ColorScale::over(cells.iter().copied()) else {
            return Err(Error::new("the map has no finite value").at(&self.title));
        };
        let mut svg = String::new();
        self.draw(&mut svg, &cells, &scale, axes)
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
        axes: [DVec3; 3],
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
        for (i, value) in cells.iter().enumerate() {
            let (row, column) = (i as i32 / N_LONGITUDES, i as i32 % N_LONGITUDES);
            let corner = (left + column * CELL, top + row * CELL);
            let color = scale.color(*value).filled();
            root.draw(&Rectangle::new(
                [corner, (corner.0 + CELL, corner.1 + CELL)],
                color,
            ))?;
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
        let caption = "longitude across and latitude upwards, degrees about the focus";
        root.draw(&Text::new(caption, (left, top + height + 24), (FONT, 16)))?;
        let mut x = left;
        for mark in &self.marks {
            let [r, g, b] = mark.color;
            let color = RGBColor(r, g, b);
            for d in &mark.directions {
                let (longitude, latitude) = angles(axes, *d);
                let place = (
                    left + (f64::from(width) * (longitude + 180.0) / 360.0) as i32,
                    top + (f64::from(height) * (90.0 - latitude) / 180.0) as i32,
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

/// The unit direction of a cell's middle; row 0 is at the pole that `axes[2]` points to.
fn direction(axes: [DVec3; 3], row: i32, column: i32) -> DVec3 {
    let step = std::f64::consts::TAU / f64::from(N_LONGITUDES);
    let longitude = (f64::from(column) + 0.5) * step - std::f64::consts::PI;
    let latitude = std::f64::consts::FRAC_PI_2 - (f64::from(row) + 0.5) * step;
    let (sin, cos) = longitude.sin_cos();
    (axes[0] * cos + axes[1] * sin) * latitude.cos() + axes[2] * latitude.sin()
}

/// Longitude and latitude of a unit direction, degrees.
fn angles(axes: [DVec3; 3], d: DVec3) -> (f64, f64) {
    let [x, y, z] = axes.map(|axis| axis.dot(d));
    (
        y.atan2(x).to_degrees(),
        z.clamp(-1.0, 1.0).asin().to_degrees(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_invert_directions() {
        let up = DVec3::new(0.3, -0.8, 0.2).normalize();
        let right = up.any_orthonormal_vector();
        let axes = [right, up.cross(right), up];
        for (row, column) in [(0, 0), (7, 93), (59, 119), (30, 60)] {
            let (longitude, latitude) = angles(axes, direction(axes, row, column));
            let step = 360.0 / f64::from(N_LONGITUDES);
            assert!((longitude - ((f64::from(column) + 0.5) * step - 180.0)).abs() < 1e-9);
            assert!((latitude - (90.0 - (f64::from(row) + 0.5) * step)).abs() < 1e-9);
        }
    }
}
