//! This module says in which unit a model is exported.

use std::str::FromStr;

use crate::error::{Error, Result};

/// The unit of what is exported.
#[derive(Clone, Debug, PartialEq)]
pub enum Size {
    /// The scene's own.
    AsItIs,
    /// So many new units are one of the scene's.
    Factor(f64),
    /// Metres, by a distance that is known.
    Metres(Distance),
    /// The scene's own times the power of 2 from which viewers with a near plane of 0.2 show all
    /// that the run's cameras see.
    ViewerSafe,
}

/// A distance between the centres of two views that someone has measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Distance {
    /// The views' names.
    pub views: [String; 2],
    /// Metres between them.
    pub metres: f64,
}

impl FromStr for Distance {
    type Err = Error;

    /// Reads `VIEW:VIEW=LENGTH`.
    fn from_str(text: &str) -> Result<Distance> {
        let parts = text
            .rsplit_once('=')
            .and_then(|(views, length)| Some((views.split_once(':')?, length.parse().ok()?)));
        let Some(((a, b), metres)) = parts else {
            return Err(Error::usage("this is no distance between two views")
                .way_out("write VIEW:VIEW=LENGTH, as in a.jpg:b.jpg=1.35"));
        };
        check_length(metres, "the distance")?;
        Ok(Distance {
            views: [a, b].map(str::to_owned),
            metres,
        })
    }
}

/// Refuses a length or factor that is none.
pub(super) fn check_length(value: f64, what: &str) -> Result<()> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::usage(format!(
        "{what} is {value}, but must be above 0 and finite"
    )))
}
