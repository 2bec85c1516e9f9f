//! This module tells whether the training cameras look at the focus or away from it.

use super::Focus;
use crate::camera::Camera;

/// A focus less than this share of `R` behind a camera may as well lie before it.
const MIN_BEHIND: f64 = 0.01;

/// Names that a warning lists.
const MAX_LISTED: usize = 3;

/// How the training cameras look, seen from the focus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outlook {
    n_cameras: usize,
    /// Indices of the cameras that have the focus behind them.
    pub away: Vec<usize>,
}

impl Outlook {
    /// Looks which of the training `cameras` have `focus` behind them.
    pub fn of(cameras: &[Camera], focus: &Focus) -> Outlook {
        let is_away = |camera: &Camera| {
            let ahead = camera.forward().dot(focus.center - camera.center());
            ahead < -MIN_BEHIND * focus.radius
        };
        Outlook {
            n_cameras: cameras.len(),
            away: (0..cameras.len())
                .filter(|i| is_away(&cameras[*i]))
                .collect(),
        }
    }

    /// Returns whether half of the cameras or more look away from the focus: then a view from the
    /// sphere around it that looks at it shows little of what they see.
    pub fn is_outward(&self) -> bool {
        !self.away.is_empty() && 2 * self.away.len() >= self.n_cameras
    }

    /// Returns a line for the log; `None` if all cameras look at the focus. `cameras` are those
    /// that it was made of.
    pub fn warning(&self, cameras: &[Camera]) -> Option<String> {
        let (n_away, n) = (self.away.len(), self.n_cameras);
        let names: Vec<String> = self
            .away
            .iter()
            .take(MAX_LISTED)
            .map(|i| format!("`{}`", cameras[*i].name.escape_debug()))
            .collect();
        let more = if n_away > MAX_LISTED { ", ..." } else { "" };
        let names = names.join(", ") + more;
        if self.is_outward() {
            Some(format!(
                "{n_away} of {n} training cameras have the focus behind them ({names}): they look outward, so virtual \
                 views stand among the cameras and look as these look, whatever views.strategy says"
            ))
        } else if n_away > 0 {
            Some(format!(
                "{n_away} of {n} training cameras have the focus behind them ({names}): virtual views around it show \
                 little of what these see; leave them out with --train-views, or choose views that look at one place"
            ))
        } else {
            None
        }
    }
}
