//! The range of every value.

use std::fmt::Display;
use std::ops::RangeInclusive;

use super::{Config, MIN_DISC_RADIUS_PX, Strategy};
use crate::error::{Error, Result};

impl Config {
    /// Checks every value's range and the order of those that belong together. The usage error
    /// names key, value and what is allowed.
    pub fn validate(&self) -> Result<()> {
        self.validate_counts()?;
        self.validate_carving()?;
        self.validate_method()?;
        self.validate_optimizer()?;
        self.validate_rules()
    }

    fn validate_counts(&self) -> Result<()> {
        within("iterations", self.iterations, 1..=100_000_000)?;

        let scene = &self.scene;
        within("scene.max_width_px", scene.max_width_px, 1..=65_535)?;
        if let Some(px) = scene.max_size_px {
            within("scene.max_size_px", px, 1..=65_535)?;
        }
        within("scene.n_train", scene.n_train, 1..=1_000_000)?;
        within("scene.n_test", scene.n_test, 0..=1_000_000)?;
        if let Some(n) = scene.max_points {
            within("scene.max_points", n, 1..=u32::MAX as usize)?;
        }
        Ok(())
    }

    fn validate_method(&self) -> Result<()> {
        let field = &self.field;
        positive("field.sigma", field.sigma)?;
        not_negative("field.lambda", field.lambda)?;
        within("field.n_candidates", field.n_candidates, 1..=1_000_000)?;

        let views = &self.views;
        // Drawn without replacement.
        ensure(
            views.count <= field.n_candidates,
            "views.count",
            views.count,
            format!("0 to field.n_candidates, which is {}", field.n_candidates),
        )?;
        positive("views.epsilon", views.epsilon)?;
        self.validate_visibility()?;

        let splat = &self.splat;
        let radii = MIN_DISC_RADIUS_PX..=64.0;
        within("splat.max_radius_px", splat.max_radius_px, radii)?;
        within("splat.depth_tolerance", splat.depth_tolerance, 0.0..=1.0)?;
        let window = splat.filter_window_px;
        odd_window("splat.filter_window_px", window)?;
        let neighbors = window * window - 1;
        within(
            "splat.filter_min_neighbors",
            splat.filter_min_neighbors,
            0..=neighbors,
        )?;
        within("splat.min_confidence", splat.min_confidence, 0.0..=1.0)?;

        let model = &self.model;
        within("model.sh_degree", model.sh_degree, 0..=3)?;
        within("model.sh_interval", model.sh_interval, 1..=u32::MAX)?;
        inside_unit("model.initial_opacity", model.initial_opacity)?;
        if let Some(ratio) = model.max_initial_scale_ratio {
            positive("model.max_initial_scale_ratio", ratio)?;
        }
        inside_unit("model.near", model.near)?;
        for channel in model.background {
            within("model.background", channel, 0.0..=1.0)?;
        }

        let shell = &self.shell;
        // Fewer would be so large that they reach the cameras.
        ensure(
            shell.count == 0 || (100..=1_000_000).contains(&shell.count),
            "shell.count",
            shell.count,
            "0, or 100 to 1000000",
        )?;
        within("shell.radius", shell.radius, 2.0..=1e6)?;

        let loss = &self.loss;
        within("loss.ssim_weight", loss.ssim_weight, 0.0..=1.0)?;
        not_negative("loss.virtual_weight", loss.virtual_weight)?;
        within("loss.fill_weight", loss.fill_weight, 0.0..=1.0)?;
        self.validate_dropout()?;
        self.validate_poses()
    }

    fn validate_dropout(&self) -> Result<()> {
        let dropout = &self.dropout;
        for (key, rate) in [
            ("dropout.rate_start", dropout.rate_start),
            ("dropout.rate_end", dropout.rate_end),
        ] {
            ensure(
                (0.0..1.0).contains(&rate),
                key,
                rate,
                "at least 0 and below 1",
            )?;
        }
        within("dropout.depth_weight", dropout.depth_weight, 0.0..=1.0)?;
        // The shares are probabilities.
        let most = 1.0 - dropout.depth_weight;
        within("dropout.density_weight", dropout.density_weight, 0.0..=most)
    }

    fn validate_poses(&self) -> Result<()> {
        let poses = &self.poses;
        within("poses.turn_lr", poses.turn_lr, 0.0..=0.1)?;
        within("poses.shift_lr", poses.shift_lr, 0.0..=0.1)?;
        // The decay is exponential, so it cannot end at 0.
        within("poses.rate_left", poses.rate_left, 1e-6..=1.0)
    }

    fn validate_visibility(&self) -> Result<()> {
        let visibility = &self.views.visibility;
        ensure(
            visibility.max_angle_deg > 0.0 && visibility.max_angle_deg <= 180.0,
            "views.visibility.max_angle_deg",
            visibility.max_angle_deg,
            "above 0, at most 180",
        )?;
        if let Some(angle) = visibility.mask_angle_deg {
            ensure(
                angle > 0.0 && angle <= 180.0,
                "views.visibility.mask_angle_deg",
                angle,
                "null, or above 0 and at most 180",
            )?;
        }
        // Beyond, small shares leave no weight that a number can hold.
        within("views.visibility.power", visibility.power, 0.0..=16.0)?;
        within(
            "views.visibility.min_share",
            visibility.min_share,
            0.0..=1.0,
        )?;
        inside_unit(
            "views.visibility.depth_tolerance",
            visibility.depth_tolerance,
        )?;
        ensure(
            !(visibility.enabled && self.views.strategy == Strategy::Interpolation),
            "views.visibility.enabled",
            visibility.enabled,
            "false with views.strategy interpolation, which has no candidates to weigh",
        )
    }

    fn validate_carving(&self) -> Result<()> {
        let carve = &self.carve;
        within("carve.threshold", carve.threshold, 0.0..=1.0)?;
        odd_window("carve.window_px", carve.window_px)?;
        inside_unit("carve.depth_tolerance", carve.depth_tolerance)?;
        within("carve.max_rounds", carve.max_rounds, 1..=1000)?;
        inside_unit("carve.max_share", carve.max_share)
    }

    fn validate_optimizer(&self) -> Result<()> {
        let optimizer = &self.optimizer;
        // The schedule between them is exponential, so neither can be 0.
        positive("optimizer.mean_lr_start", optimizer.mean_lr_start)?;
        positive("optimizer.mean_lr_end", optimizer.mean_lr_end)?;
        ordered(
            ("optimizer.mean_lr_end", optimizer.mean_lr_end),
            ("optimizer.mean_lr_start", optimizer.mean_lr_start),
        )?;
        not_negative("optimizer.sh_lr", optimizer.sh_lr)?;
        not_negative("optimizer.opacity_lr", optimizer.opacity_lr)?;
        not_negative("optimizer.scale_lr", optimizer.scale_lr)?;
        not_negative("optimizer.rotation_lr", optimizer.rotation_lr)?;
        for (key, beta) in [
            ("optimizer.beta1", optimizer.beta1),
            ("optimizer.beta2", optimizer.beta2),
        ] {
            ensure(
                (0.0..1.0).contains(&beta),
                key,
                beta,
                "at least 0 and below 1",
            )?;
        }
        positive("optimizer.epsilon", optimizer.epsilon)
    }

    fn validate_rules(&self) -> Result<()> {
        let densify = &self.densify;
        ordered(
            ("densify.start", densify.start),
            ("densify.end", densify.end),
        )?;
        within("densify.interval", densify.interval, 1..=u32::MAX)?;
        positive("densify.gradient_threshold", densify.gradient_threshold)?;
        positive("densify.split_scale", densify.split_scale)?;
        // Otherwise the first pruning removes every Gaussian.
        ensure(
            densify.min_opacity >= 0.0 && densify.min_opacity < self.model.initial_opacity,
            "densify.min_opacity",
            densify.min_opacity,
            format!(
                "at least 0 and below model.initial_opacity, which is {}",
                self.model.initial_opacity
            ),
        )?;
        positive("densify.max_scale", densify.max_scale)?;
        if let Some(share) = densify.max_screen {
            positive("densify.max_screen", share)?;
        }
        within(
            "densify.opacity_reset_interval",
            densify.opacity_reset_interval,
            1..=u32::MAX,
        )?;
        within(
            "densify.max_gaussians",
            densify.max_gaussians,
            1..=u32::MAX as usize,
        )?;

        let coverage = &self.coverage;
        within("coverage.interval", coverage.interval, 1..=u32::MAX)?;
        for (key, tau) in [
            ("coverage.tau_min", coverage.tau_min),
            ("coverage.tau_max", coverage.tau_max),
        ] {
            // An anisotropy is a ratio of the longest to the shortest axis.
            ensure(
                tau.is_finite() && tau >= 1.0,
                key,
                tau,
                "a finite number, 1 or more",
            )?;
        }
        ordered(
            ("coverage.tau_min", coverage.tau_min),
            ("coverage.tau_max", coverage.tau_max),
        )?;
        positive("coverage.delta_min", coverage.delta_min)?;
        positive("coverage.delta_max", coverage.delta_max)?;
        ordered(
            ("coverage.delta_min", coverage.delta_min),
            ("coverage.delta_max", coverage.delta_max),
        )?;
        positive("coverage.anisotropy_epsilon", coverage.anisotropy_epsilon)?;
        within(
            "coverage.max_pruned_share",
            coverage.max_pruned_share,
            0.0..=1.0,
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

/// NaN is in no range, so it is refused everywhere.
fn within<T: PartialOrd + Display + Copy>(
    key: &str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<()> {
    let (low, high) = (*range.start(), *range.end());
    ensure(
        range.contains(&value),
        key,
        value,
        format!("{low} to {high}"),
    )
}

fn odd_window(key: &str, px: u32) -> Result<()> {
    ensure(
        px % 2 == 1 && px <= 63,
        key,
        px,
        "an odd number from 1 to 63",
    )
}

fn positive(key: &str, value: f64) -> Result<()> {
    ensure(
        value.is_finite() && value > 0.0,
        key,
        value,
        "a finite number above 0",
    )
}

fn not_negative(key: &str, value: f64) -> Result<()> {
    ensure(
        value.is_finite() && value >= 0.0,
        key,
        value,
        "a finite number, 0 or more",
    )
}

fn inside_unit(key: &str, value: f64) -> Result<()> {
    ensure(
        value > 0.0 && value < 1.0,
        key,
        value,
        "above 0 and below 1",
    )
}

fn ordered<T: PartialOrd + Display>(low: (&str, T), high: (&str, T)) -> Result<()> {
    ensure(
        low.1 <= high.1,
        low.0,
        low.1,
        format!("at most `{}`, which is {}", high.0, high.1),
    )
}
