//! This module draws plots as SVG by `plotters`: curves, scatters and maps with labelled axes.

mod axis;
mod map;

pub use axis::Axis;
use axis::Places;
pub use map::{MapMark, SphereMap};

use std::ops::Range;
use std::path::Path;

use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::prelude::*;

use crate::error::{Error, Result};
use crate::files::write_file;

/// Size of a plot, pixels.
const SIZE: (u32, u32) = (800, 500);

/// Width of the strip that holds the scale of colours.
const BAR_WIDTH: u32 = 90;

/// About the width of a letter in a legend, pixels.
const LETTER_WIDTH: u32 = 8;

const FONT: &str = "sans-serif";

/// Okabe and Ito's colours: told apart with colour-blind eyes, too.
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// A place in a plot; `spread` is half the length of its error bar, in units of `y`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Value on the first axis.
    pub x: f64,
    /// Value on the second axis.
    pub y: f64,
    /// Half the length of the error bar; `None` for a point without one.
    pub spread: Option<f64>,
}

impl Point {
    /// Returns a point without an error bar.
    pub fn new(x: f64, y: f64) -> Point {
        Point { x, y, spread: None }
    }
}

/// How the points of a series are drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Style {
    /// Joined in order.
    Curve,
    /// Apart from one another.
    Marks,
    /// Each in the colour of its value, one a point; the plot's `color_label` names them.
    Colored(Vec<f64>),
}

/// Points that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; an empty one is not listed.
    pub name: String,
    /// In the order in which a curve joins them.
    pub points: Vec<Point>,
    /// How they are drawn.
    pub style: Style,
}

/// A plot of series over two axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// The text above the plot.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Drawn in this order, the last on top.
    pub series: Vec<Series>,
    /// Label of the colours of [`Style::Colored`], with its unit.
    pub color_label: String,
}

type Area<'a, 'b> = DrawingArea<SVGBackend<'b>, Shift>;
type Coordinates = Cartesian2d<Places, Places>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Coordinates>;

impl Plot {
    /// Returns a plot without a series; [`Plot::with`] adds them.
    pub fn new(title: &str, x: Axis, y: Axis) -> Plot {
        Plot {
            title: title.to_owned(),
            x,
            y,
            series: Vec::new(),
            color_label: String::new(),
        }
    }

    /// Returns the plot with one more series.
    pub fn with(mut self, name: &str, style: Style, points: Vec<Point>) -> Plot {
        self.series.push(Series {
            name: name.to_owned(),
            points,
            style,
        });
        self
    }

    /// Draws the plot as a document of its own. Points that an axis cannot show (not finite, or not
    /// positive on a logarithmic one) are left out.
    ///
    /// # Errors
    /// No point is left, or a coloured series lacks a value for a point.
    pub fn to_svg(&self) -> Result<String> {
        for series in &self.series {
            if let Style::Colored(values) = &series.style
                && values.len() != series.points.len()
            {
                return Err(Error::new(format!(
                    "series `{}` has {} points and {} values",
                    series.name,
                    series.points.len(),
                    values.len()
                ))
                .at(&self.title));
            }
        }
        let (xs, ys) = self.extents();
        let (Some(xs), Some(ys)) = (xs, ys) else {
            return Err(Error::new("the plot has no point to show").at(&self.title));
        };
        let mut svg = String::new();
        self.draw(&mut svg, &xs, &ys)
            .map_err(|e| Error::new(format!("cannot draw: {e}")).at(&self.title))?;
        Ok(svg)
    }

    /// Writes the plot as an SVG file.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_file(path, self.to_svg()?.as_bytes())
    }

    /// Returns whether both axes can show a point.
    fn shows(&self, point: &Point) -> bool {
        self.x.place(point.x).is_finite() && self.y.place(point.y).is_finite()
    }

    fn extents(&self) -> (Option<Range<f64>>, Option<Range<f64>>) {
        let points = || self.series.iter().flat_map(|series| &series.points);
        let points = || points().filter(|point| self.shows(point));
        let ends = |p: &Point| {
            let spread = p.spread.unwrap_or(0.0);
            [p.y - spread, p.y + spread]
        };
        (
            self.x.extent(points().map(|p| p.x)),
            self.y.extent(points().flat_map(ends)),
        )
    }

    fn draw(
        &self,
        svg: &mut String,
        xs: &Range<f64>,
        ys: &Range<f64>,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let colors = ColorScale::of(&self.series);
        let bar_width = colors.as_ref().map_or(0, |_| BAR_WIDTH);
        let (rest, bar) = root.split_horizontally(SIZE.0 - bar_width);
        let (area, legend) = rest.split_horizontally(SIZE.0 - bar_width - self.legend_width());
        let mut chart = ChartBuilder::on(&area)
            .caption(&self.title, (FONT, 22))
            .margin(12)
            .x_label_area_size(48)
            .y_label_area_size(68)
            .build_cartesian_2d(self.x.places(xs), self.y.places(ys))?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_desc(self.x.label.as_str())
            .y_desc(self.y.label.as_str())
            .axis_desc_style((FONT, 18))
            .label_style((FONT, 16))
            .x_labels(64)
            .y_labels(64)
            .x_label_formatter(&|v| self.x.format(*v))
            .y_label_formatter(&|v| self.y.format(*v))
            .draw()?;
        for (i, series) in self.series.iter().enumerate() {
            self.draw_series(&mut chart, series, COLORS[i % COLORS.len()], &colors)?;
        }
        self.draw_legend(&legend)?;
        if let Some(colors) = &colors {
            colors.draw(&bar, &self.color_label)?;
        }
        root.present()?;
        Ok(())
    }

    fn draw_series(
        &self,
        chart: &mut Chart,
        series: &Series,
        color: RGBColor,
        colors: &Option<ColorScale>,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let place = |x: f64, y: f64| (self.x.place(x), self.y.place(y));
        let shown = || series.points.iter().filter(|p| self.shows(p));
        for p in shown() {
            if let Some(spread) = p.spread.filter(|s| s.is_finite() && *s > 0.0) {
                let (x, low) = place(p.x, p.y - spread);
                let (_, high) = place(p.x, p.y + spread);
                if low.is_finite() {
                    let bar = PathElement::new(vec![(x, low), (x, high)], color.mix(0.6));
                    chart.draw_series(std::iter::once(bar))?;
                }
            }
        }
        match &series.style {
            Style::Curve => {
                let line = shown().map(|p| place(p.x, p.y));
                chart.draw_series(LineSeries::new(line, color.stroke_width(2)))?;
                let marks = shown().map(|p| Circle::new(place(p.x, p.y), 3, color.filled()));
                chart.draw_series(marks)?;
            }
            Style::Marks => {
                let marks = shown().map(|p| Circle::new(place(p.x, p.y), 4, color.filled()));
                chart.draw_series(marks)?;
            }
            Style::Colored(values) => {
                let both = series.points.iter().zip(values);
                let marks = both.filter(|(p, _)| self.shows(p)).map(|(p, value)| {
                    let color = colors.as_ref().map_or(BLACK, |scale| scale.color(*value));
                    Circle::new(place(p.x, p.y), 4, color.filled())
                });
                chart.draw_series(marks)?;
            }
        }
        Ok(())
    }

    /// Returns the series that the legend lists, with their colours.
    fn listed(&self) -> impl Iterator<Item = (&str, RGBColor)> {
        let colors = COLORS.iter().cycle();
        let named = self.series.iter().zip(colors);
        named
            .map(|(series, color)| (series.name.as_str(), *color))
            .filter(|(name, _)| !name.is_empty())
    }

    /// Returns the width of the legend, which stands beside the plot: on it, it would hide points.
    fn legend_width(&self) -> u32 {
        let longest = self.listed().map(|(name, _)| name.chars().count()).max();
        longest.map_or(0, |n| (30 + LETTER_WIDTH * n as u32).min(SIZE.0 / 3))
    }

    fn draw_legend(&self, area: &Area) -> std::result::Result<(), Box<dyn std::error::Error>> {
        for (i, (name, color)) in self.listed().enumerate() {
            let y = 56 + 20 * i as i32;
            area.draw(&Circle::new((6, y), 4, color.filled()))?;
            area.draw(&Text::new(name.to_owned(), (16, y - 6), (FONT, 16)))?;
        }
        Ok(())
    }
}

/// Returns Viridis' colour of a share in [0, 1], RGB.
pub(super) fn viridis(share: f64) -> [u8; 3] {
    let RGBColor(r, g, b) = ViridisRGB.get_color(share);
    [r, g, b]
}

/// Colours of a scale.
const COLOR_STEPS: i32 = 64;

/// Maps values to colours between their least and greatest.
struct ColorScale(Range<f64>);

impl ColorScale {
    fn of(series: &[Series]) -> Option<ColorScale> {
        let values = series.iter().filter_map(|series| match &series.style {
            Style::Colored(values) => Some(values),
            _ => None,
        });
        ColorScale::over(values.flatten().copied())
    }

    /// Makes the scale of some values; `None` without a finite one.
    fn over(values: impl Iterator<Item = f64>) -> Option<ColorScale> {
        let finite = values.filter(|v| v.is_finite());
        let range = finite.fold(f64::INFINITY..f64::NEG_INFINITY, |range, v| {
            range.start.min(v)..range.end.max(v)
        });
        (range.start <= range.end).then_some(ColorScale(range))
    }

    /// Returns a value's colour in as many steps as the bar has, so that large areas of a colour
    /// are one shape.
    fn color(&self, value: f64) -> RGBColor {
        let span = self.0.end - self.0.start;
        let share = if span > 0.0 {
            ((value - self.0.start) / span).clamp(0.0, 1.0)
        } else {
            0.5
        };
        let step = (share * f64::from(COLOR_STEPS))
            .floor()
            .min(f64::from(COLOR_STEPS - 1));
        ViridisRGB.get_color(step / f64::from(COLOR_STEPS - 1))
    }

    /// Draws the scale as an upright bar with its ends and middle labelled.
    fn draw(
        &self,
        area: &Area,
        label: &str,
    ) -> std::result::Result<(), Box<dyn std::error::Error>> {
        let (_, height) = area.dim_in_pixel();
        let (top, bottom) = (56, height as i32 - 60);
        let span = self.0.end - self.0.start;
        let y = |step: i32| bottom + (top - bottom) * step / COLOR_STEPS;
        for step in 0..COLOR_STEPS {
            let value = self.0.start + span * (f64::from(step) + 0.5) / f64::from(COLOR_STEPS);
            area.draw(&Rectangle::new(
                [(8, y(step + 1)), (24, y(step))],
                self.color(value).filled(),
            ))?;
        }
        for step in [0, COLOR_STEPS / 2, COLOR_STEPS] {
            let value = self.0.start + span * f64::from(step) / f64::from(COLOR_STEPS);
            let text = axis::plain(value);
            area.draw(&Text::new(text, (28, y(step) - 6), (FONT, 15)))?;
        }
        area.draw(&Text::new(label.to_owned(), (0, top - 26), (FONT, 15)))?;
        Ok(())
    }
}
