//! This module moves the origin and scales the scene so that its numbers fit a .spz file.

use glam::DVec3;

use super::{Gaussians, MAX_FIXED, SCALE_LOG};

/// Gaussians that lie so many times as far as this share of them reaches are left out if they would
/// spoil too many of the others.
const WITHIN: f64 = 0.999;
const FAR: f64 = 4.0;
/// Share of the Gaussians that may be spoilt: smaller than the step of their positions, or larger
/// or smaller than the format holds.
const MAX_SPOILT: f64 = 0.01;
/// The scene may be multiplied by 2 to the power of any of these: from the largest f32 to the
/// smallest.
const POWERS: std::ops::RangeInclusive<i32> = -110..=110;

/// The grid that coordinates are stored on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Origin of the grid, which is subtracted from the means.
    pub origin: DVec3,
    /// The scene is multiplied by 2 to the power of this.
    power: i32,
    /// Bits behind the point: as many as leave room for the farthest mean.
    pub fraction_bits: i32,
}

impl Grid {
    /// Makes a grid for means that reach `farthest`; `None` if they do not fit.
    fn new(origin: DVec3, power: i32, farthest: f64) -> Option<Grid> {
        let fits = |bits: &i32| exp2(power + bits) * farthest <= MAX_FIXED;
        let fraction_bits = (0..=20).rev().find(fits)?;
        Some(Grid {
            origin,
            power,
            fraction_bits,
        })
    }

    /// Steps in a unit of the scene as it is.
    pub(crate) fn steps_a_unit(self) -> f64 {
        exp2(self.power + self.fraction_bits)
    }

    /// Returns what is added to a scale's natural logarithm.
    pub(crate) fn scale_log(self) -> f32 {
        self.power as f32 * std::f32::consts::LN_2
    }
}

fn exp2(power: i32) -> f64 {
    f64::from(power).exp2()
}

/// How far Gaussians reach from an origin and how large they are, each sorted.
struct Extents {
    origin: DVec3,
    reaches: Vec<f64>,
    /// Natural logarithms of the largest scales.
    sizes_log: Vec<f32>,
}

impl Extents {
    fn of(gaussians: &Gaussians, chosen: &[usize], origin: DVec3) -> Extents {
        let mut reaches: Vec<f64> = chosen
            .iter()
            .map(|i| reach(gaussians, *i, origin))
            .collect();
        reaches.sort_unstable_by(f64::total_cmp);
        let sizes = chosen
            .iter()
            .map(|i| gaussians.scales_log[*i].max_element());
        let mut sizes_log: Vec<f32> = sizes.collect();
        sizes_log.sort_unstable_by(f32::total_cmp);
        Extents {
            origin,
            reaches,
            sizes_log,
        }
    }

    /// Tries the scene times 2 to the `power`.
    fn tried(&self, power: i32) -> Option<Fitted> {
        let farthest = self.reaches.last().copied().unwrap_or(0.0);
        let grid = Grid::new(self.origin, power, farthest)?;
        let step_log = -(grid.fraction_bits as f32) * std::f32::consts::LN_2;
        let least = SCALE_LOG.start().max(step_log) - grid.scale_log();
        let most = SCALE_LOG.end() - grid.scale_log();
        let n_small = self.sizes_log.partition_point(|s| *s < least);
        let n_large = self.sizes_log.len() - self.sizes_log.partition_point(|s| *s <= most);
        let n = self.sizes_log.len().max(1);
        Some(Fitted {
            spoilt: (n_small + n_large) as f64 / n as f64,
            grid,
        })
    }

    /// Chooses the scene as it is, unless that spoils too many and another power of 2 spoils fewer:
    /// then the nearest to it of those that spoil the fewest.
    fn best(&self) -> Fitted {
        let as_it_is = self.tried(0).filter(|fitted| fitted.spoilt <= MAX_SPOILT);
        let mut powers: Vec<i32> = POWERS.collect();
        powers.sort_by_key(|power| power.abs());
        let fewest = || {
            let all = powers.into_iter().filter_map(|power| self.tried(power));
            all.reduce(|a, b| if b.spoilt < a.spoilt { b } else { a })
        };
        let nothing_fits = Grid {
            origin: self.origin,
            power: 0,
            fraction_bits: 0,
        };
        as_it_is.or_else(fewest).unwrap_or(Fitted {
            spoilt: 1.0,
            grid: nothing_fits,
        })
    }
}

/// A grid, and the share of the Gaussians that it spoils.
struct Fitted {
    spoilt: f64,
    grid: Grid,
}

/// Returns the largest coordinate about an origin.
fn reach(gaussians: &Gaussians, i: usize, origin: DVec3) -> f64 {
    (gaussians.means[i].as_dvec3() - origin).abs().max_element()
}

/// Chooses the grid, and leaves out of `chosen` what is so far that too many of the others would be
/// spoilt. It changes the origin, else the scale, else the number of Gaussians: the first that
/// helps.
pub(super) fn fit(
    gaussians: &Gaussians,
    chosen: &mut Vec<usize>,
    warnings: &mut Vec<String>,
) -> Grid {
    let mut extents = Extents::of(gaussians, chosen, DVec3::ZERO);
    let Fitted {
        mut spoilt,
        mut grid,
    } = extents.best();
    if spoilt > MAX_SPOILT || grid.power != 0 {
        let about = Extents::of(gaussians, chosen, middle(gaussians, chosen));
        let best = about.best();
        if (best.spoilt, best.grid.power.abs()) < (spoilt, grid.power.abs()) {
            Fitted { spoilt, grid } = best;
            extents = about;
        }
    }
    if spoilt > MAX_SPOILT {
        let last = (WITHIN * extents.reaches.len().saturating_sub(1) as f64).round() as usize;
        let limit = FAR * extents.reaches[last];
        let is_near = |i: &usize| reach(gaussians, *i, extents.origin) <= limit;
        let near: Vec<usize> = chosen.iter().copied().filter(is_near).collect();
        let best = Extents::of(gaussians, &near, extents.origin).best();
        if best.spoilt < spoilt {
            warnings.push(format!(
                "{} Gaussians beyond {limit} units are left out: with them a .spz file would round all \
                 positions to steps of {:.1e}",
                chosen.len() - near.len(),
                1.0 / grid.steps_a_unit()
            ));
            *chosen = near;
            Fitted { spoilt, grid } = best;
        }
    }
    if grid.origin != DVec3::ZERO {
        warnings.push(format!(
            "positions are without {} {} {}, about which a .spz file holds them in smaller steps",
            grid.origin.x, grid.origin.y, grid.origin.z
        ));
    }
    if grid.power != 0 {
        warnings.push(format!(
            "the scene is multiplied by {}, since a .spz file holds sizes from {:.1e} to {:.0} units",
            exp2(grid.power),
            SCALE_LOG.start().exp(),
            SCALE_LOG.end().exp()
        ));
    }
    if spoilt > MAX_SPOILT {
        warnings.push(format!(
            "{:.1} % of the Gaussians are smaller than the steps of {:.1e} to which positions are rounded, or of \
             a size that is not held: a .splat file has no such bounds",
            100.0 * spoilt,
            1.0 / grid.steps_a_unit()
        ));
    }
    grid
}

/// Returns the medians of the means' coordinates.
fn middle(gaussians: &Gaussians, chosen: &[usize]) -> DVec3 {
    let axis = |axis: usize| {
        let mut values: Vec<f32> = chosen.iter().map(|i| gaussians.means[*i][axis]).collect();
        let middle = values.len() / 2;
        match values.is_empty() {
            true => 0.0,
            false => f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1),
        }
    };
    DVec3::new(axis(0), axis(1), axis(2))
}
