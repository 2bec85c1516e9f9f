//! Findings, the results of comparisons.

use serde::Serialize;

use crate::doctor::twin::compare::{held_l2, held_off_mask};

/// One quantity of one stage held against the reference.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Name of the stage, one of those in `stage::ALL`.
    pub stage: &'static str,
    /// The input, with its size.
    pub case: String,
    /// The quantity that was compared.
    pub what: String,
    /// Relative L2, largest difference of an image, or number of integers that differ; infinite
    /// (null in JSON) where a value is not finite.
    pub error: f64,
    /// Largest error that passes; 0 for integers.
    pub bound: f64,
}

impl Finding {
    /// Returns whether the error is in bounds.
    pub fn holds(&self) -> bool {
        self.error <= self.bound
    }

    /// Returns the error as a share of its bound.
    pub fn severity(&self) -> f64 {
        if self.error == 0.0 {
            0.0
        } else {
            self.error / self.bound
        }
    }
}

/// The findings of one case as they come.
#[derive(Clone, Debug)]
pub struct Findings {
    case: String,
    /// The findings so far, in the order in which they came.
    pub list: Vec<Finding>,
}

impl Findings {
    /// Starts without findings, for the case that `case` names, with its size.
    pub fn of(case: impl Into<String>) -> Findings {
        Findings {
            case: case.into(),
            list: Vec::new(),
        }
    }

    /// Adds the relative L2 error against the reference.
    pub fn close(
        &mut self,
        (stage, what): (&'static str, &str),
        ours: &[f64],
        reference: &[f64],
        bound: f64,
    ) {
        self.add((stage, what), held_l2(ours, reference, bound), bound);
    }

    /// Adds the largest difference over the pixels that `mask` leaves out.
    pub fn image(
        &mut self,
        (stage, what): (&'static str, &str),
        ours: &[f64],
        reference: &[f64],
        mask: &[bool],
        bound: f64,
    ) {
        let error = held_off_mask(ours, reference, mask, bound);
        self.add((stage, what), error, bound);
    }

    /// Adds the number of entries that differ.
    pub fn equal<T: PartialEq>(
        &mut self,
        (stage, what): (&'static str, &str),
        ours: &[T],
        reference: &[T],
    ) {
        let missing = ours.len().abs_diff(reference.len());
        let differ = ours.iter().zip(reference).filter(|(a, b)| a != b).count();
        self.none((stage, what), missing + differ);
    }

    /// Adds the number of entries that are wrong, of which none may be.
    pub fn none(&mut self, (stage, what): (&'static str, &str), n_wrong: usize) {
        self.add((stage, what), n_wrong as f64, 0.0);
    }

    /// Adds an error of any other kind; a NaN counts as infinite.
    pub fn add(&mut self, (stage, what): (&'static str, &str), error: f64, bound: f64) {
        self.list.push(Finding {
            stage,
            case: self.case.clone(),
            what: what.to_owned(),
            error: if error.is_nan() { f64::INFINITY } else { error },
            bound,
        });
    }
}
