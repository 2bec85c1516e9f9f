//! This module checks each key's declared range, and the rules between two keys.

use std::fmt::Display;

use super::declare::{Entry, Value as _, any};
use super::{ColorSource, Config, Footprint, PriorDepths, PriorLoss, PriorSource, Strategy};
use crate::error::{Error, Result};

impl Config {
    /// Checks every value's range and the rules between those that belong together. The usage error
    /// names key, value and what is allowed.
    pub fn validate(&self) -> Result<()> {
        for entry in self.entries() {
            for number in &entry.numbers {
                let null = if entry.nullable { "null, or " } else { "" };
                ensure(
                    entry.rule.allowed.holds(*number),
                    &entry.key,
                    number,
                    format!("{null}{}", entry.rule.allowed),
                )?;
            }
        }
        self.validate_orders()?;
        self.validate_pairs()?;
        self.validate_partner()?;
        self.validate_generator()
    }

    /// Returns every section and key with its value, in the order of the declaration.
    pub(super) fn entries(&self) -> Vec<Entry> {
        let mut entries = Vec::new();
        self.list("", "", any(), &mut entries);
        entries
    }

    /// Refuses pairs of values of which one bounds the other from above and does not.
    fn validate_orders(&self) -> Result<()> {
        let (optimizer, densify, coverage) = (&self.optimizer, &self.densify, &self.coverage);
        ordered(
            ("optimizer.mean_lr_end", optimizer.mean_lr_end),
            ("optimizer.mean_lr_start", optimizer.mean_lr_start),
        )?;
        ordered(
            ("densify.start", densify.start),
            ("densify.end", densify.end),
        )?;
        ordered(
            ("coverage.tau_min", coverage.tau_min),
            ("coverage.tau_max", coverage.tau_max),
        )?;
        ordered(
            ("coverage.delta_min", coverage.delta_min),
            ("coverage.delta_max", coverage.delta_max),
        )?;
        // Virtual views are drawn without replacement.
        ordered(
            ("views.count", self.views.count),
            ("field.n_candidates", self.field.n_candidates),
        )
    }

    /// Refuses what changes the set of Gaussians, or trains them in another way, where a network makes them.
    fn validate_generator(&self) -> Result<()> {
        if !self.generator.enabled {
            return Ok(());
        }
        ordered(
            ("generator.lr_end", self.generator.lr_end),
            ("generator.lr_start", self.generator.lr_start),
        )?;
        let Config {
            densify,
            coverage,
            dropout,
            need,
            ..
        } = self;
        let switches = [
            ("densify.enabled", densify.enabled),
            ("coverage.prune", coverage.prune),
            ("partner.enabled", self.partner.enabled),
            ("need.prune", need.prune),
        ];
        for (key, is_on) in switches {
            ensure(!is_on, key, is_on, "false with generator.enabled")?;
        }
        let numbers = [
            ("model.sh_degree", f64::from(self.model.sh_degree)),
            ("shell.count", self.shell.count as f64),
            ("loss.flat_weight", self.loss.flat_weight),
            ("optimizer.confidence_gain", self.optimizer.confidence_gain),
            ("dropout.depth_weight", dropout.depth_weight),
            ("dropout.density_weight", dropout.density_weight),
        ];
        for (key, number) in numbers {
            ensure(number == 0.0, key, number, "0 with generator.enabled")?;
        }
        ensure(
            need.max_mb.is_none(),
            "need.max_mb",
            need.max_mb.unwrap_or_default(),
            "null with generator.enabled",
        )
    }

    /// Refuses what a partner has no place for: each set learns from two views an iteration at most, and holds the cameras.
    fn validate_partner(&self) -> Result<()> {
        if !self.partner.enabled {
            return Ok(());
        }
        let without = |what| format!("{what} with partner.enabled");
        ensure(
            self.views.count == 0,
            "views.count",
            self.views.count,
            without("0"),
        )?;
        ensure(
            !self.poses.refine,
            "poses.refine",
            self.poses.refine,
            without("false"),
        )?;
        ensure(
            self.dropout.depth_weight == 0.0,
            "dropout.depth_weight",
            self.dropout.depth_weight,
            without("0"),
        )?;
        ensure(
            self.dropout.density_weight == 0.0,
            "dropout.density_weight",
            self.dropout.density_weight,
            without("0"),
        )?;
        ensure(
            self.densify.outlier_interval.is_none(),
            "densify.outlier_interval",
            self.densify.outlier_interval.unwrap_or(0),
            without("null"),
        )?;
        ensure(
            self.unpool.until.is_none(),
            "unpool.until",
            self.unpool.until.unwrap_or(0),
            without("null"),
        )?;
        ensure(
            self.floaters.after.is_none(),
            "floaters.after",
            self.floaters.after.unwrap_or(0),
            without("null"),
        )?;
        ensure(
            self.optimizer.confidence_gain == 0.0,
            "optimizer.confidence_gain",
            self.optimizer.confidence_gain,
            without("0"),
        )?;
        ensure(
            !self.prior.is_on(),
            "prior.source",
            format!("{:?}", self.prior.source).to_lowercase(),
            without("\"none\""),
        )
    }

    fn validate_pairs(&self) -> Result<()> {
        let window = self.splat.filter_window_px;
        let neighbors = self.splat.filter_min_neighbors;
        let most = window * window - 1;
        ensure(
            neighbors <= most,
            "splat.filter_min_neighbors",
            neighbors,
            format!("0 to {most}, the neighbours in splat.filter_window_px"),
        )?;
        // The shares are probabilities.
        let most = 1.0 - self.dropout.depth_weight;
        ensure(
            self.dropout.density_weight <= most,
            "dropout.density_weight",
            self.dropout.density_weight,
            format!("0 to {most}, what dropout.depth_weight leaves"),
        )?;
        // The first pruning would remove every Gaussian.
        ensure(
            self.densify.min_opacity < self.model.initial_opacity,
            "densify.min_opacity",
            self.densify.min_opacity,
            format!(
                "at least 0 and below model.initial_opacity, which is {}",
                self.model.initial_opacity
            ),
        )?;
        ensure(
            !self.need.chooses() || self.need.hold_out > 0,
            "need.hold_out",
            self.need.hold_out,
            "2 or more with need.ends, need.prune or need.max_mb: held-out views decide",
        )?;
        let prior = &self.prior;
        let files = prior.source == PriorSource::Files;
        let is_metric = !files || prior.depths == PriorDepths::Metric;
        ensure(
            is_metric || prior.loss != PriorLoss::L1,
            "prior.loss",
            "l1",
            "pearson or scale_shift, where prior.depths are not metric",
        )?;
        ensure(
            !(files && prior.depths == PriorDepths::Relative && prior.inverse),
            "prior.inverse",
            prior.inverse,
            "false, where prior.depths are relative: their inverse has no scale and shift",
        )?;
        let is_plain = self.splat.colors == ColorSource::Points;
        ensure(
            is_plain || self.splat.footprint == Footprint::Disc,
            "splat.colors",
            if is_plain {
                "points"
            } else {
                "photographs or blend"
            },
            "points with splat.footprint pixel, which leaves no surface to warp by",
        )?;
        let visibility = self.views.visibility.enabled;
        ensure(
            !(visibility && self.views.strategy == Strategy::Interpolation),
            "views.visibility.enabled",
            visibility,
            "false with views.strategy interpolation, which has no candidates to weigh",
        )
    }
}

fn ensure(holds: bool, key: &str, value: impl Display, allowed: impl Display) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::usage(format!(
        "config key `{key}` is {value}; allowed: {allowed}"
    )))
}

fn ordered<T: PartialOrd + Display>(low: (&str, T), high: (&str, T)) -> Result<()> {
    ensure(
        low.1 <= high.1,
        low.0,
        low.1,
        format!("at most `{}`, which is {}", high.0, high.1),
    )
}
