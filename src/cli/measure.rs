//! This module holds the options that say how test views are measured, for every command that
//! measures.

use std::path::PathBuf;

use clap::Args;

use crate::error::Result;
use crate::eval::EvalOptions;
use crate::metrics::Lpips;
use crate::metrics::Renders;
use crate::metrics::lpips::InputRange;

/// How test views are measured.
#[derive(Clone, Debug, Args)]
pub(crate) struct MeasureArgs {
    /// Measure LPIPS with these weights, AlexNet's or VGG16's
    #[arg(long, value_name = "FILE.safetensors")]
    lpips_weights: Option<PathBuf>,

    /// Range that LPIPS sees black to white as
    #[arg(long, value_name = "RANGE", value_enum, default_value_t = InputRange::default(),
        allow_hyphen_values = true, requires = "lpips_weights")]
    lpips_range: InputRange,

    /// Measure renders as floats in [0, 1], not rounded to 8 bit as 3DGS does
    #[arg(long)]
    float_renders: bool,
}

impl MeasureArgs {
    /// Reads the weights.
    pub(crate) fn options(&self) -> Result<EvalOptions> {
        let weights = self.lpips_weights.as_deref();
        Ok(EvalOptions {
            lpips: weights
                .map(|path| Lpips::read(path, self.lpips_range))
                .transpose()?,
            renders: if self.float_renders {
                Renders::Float
            } else {
                Renders::Rounded
            },
            ..EvalOptions::default()
        })
    }
}
