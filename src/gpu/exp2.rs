//! This module decides whose 2^x the rasterizers take: a polynomial that is the same on every adapter, or the
//! adapter's own, which GPUs have as one instruction, where that is as good.

use super::shader::{self, Sources};
use super::{Buffer, Commands, Gpu, Kernel};
use crate::config::Exp2Choice;
use crate::error::Result;

/// Whose 2^x kernels take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exp2 {
    #[default]
    /// The program's own, to 1 unit in the last place on every adapter.
    Polynomial,
    /// The adapter's.
    Adapter,
}

/// Largest error of the adapter's own with which it is taken, units in the last place.
pub const MOST_ULPS: f64 = 2.0;

/// Exponents that are checked. Their spacing is an odd number of steps of 2^-15, so that their fractions are all of the
/// multiples of those that there is room for.
pub const N_CHECKED: usize = 1 << 14;
/// Spacing of the exponents; they end at -8.5. An alpha of less than 2^-8 is not drawn.
const SPACING: f32 = -17.0 / 32768.0;

impl Exp2 {
    /// Resolves what a config asks for on an adapter. On a driver that runs on a CPU, 2^x is a polynomial
    /// as well and is not asked for.
    ///
    /// # Errors
    /// A GPU fault while the adapter's own is checked.
    pub fn of(choice: Exp2Choice, gpu: &Gpu) -> Result<Exp2> {
        let on_cpu = gpu.info.device_type == wgpu::DeviceType::Cpu;
        let asked = match choice {
            Exp2Choice::Auto => !on_cpu,
            Exp2Choice::Polynomial => false,
            Exp2Choice::Adapter => true,
        };
        if !asked {
            return Ok(Exp2::Polynomial);
        }
        let ulps = worst_ulps(gpu, &kernel(Exp2::Adapter.sources()))?;
        let taken = Self::by_error(ulps);
        if taken == Exp2::Polynomial {
            log::info!(
                "the adapter's 2^x is off by {ulps:.1} units in the last place: the polynomial is taken"
            );
        }
        Ok(taken)
    }

    /// Returns the one to take where the adapter's own is off by so many units in the last place.
    pub fn by_error(ulps: f64) -> Exp2 {
        match ulps <= MOST_ULPS {
            true => Exp2::Adapter,
            false => Exp2::Polynomial,
        }
    }

    /// Returns the choice that asks for this one.
    pub fn choice(self) -> Exp2Choice {
        match self {
            Exp2::Polynomial => Exp2Choice::Polynomial,
            Exp2::Adapter => Exp2Choice::Adapter,
        }
    }

    /// Returns the program's shaders with this one.
    pub fn sources(self) -> Sources<'static> {
        match self {
            Exp2::Polynomial => &shader::compose,
            Exp2::Adapter => &shader::compose_with_exp2_of_adapter,
        }
    }
}

/// Makes the kernel that takes 2^x as the rasterizers of `sources` do.
pub fn kernel(sources: Sources<'_>) -> Kernel {
    Kernel::from_source("exp2", "exp2_of_all", sources("exp2", 0))
}

/// Returns the largest error of 2^x, as `kernel` takes it, over exponents between -8.5 and 0, in units in the last place
/// of the exact power.
///
/// # Errors
/// A GPU fault.
pub fn worst_ulps(gpu: &Gpu, kernel: &Kernel) -> Result<f64> {
    let exponents: Vec<f32> = (0..N_CHECKED).map(|i| SPACING * i as f32).collect();
    let from = Buffer::storage_from(gpu, "exponents", &exponents)?;
    let to = Buffer::storage::<f32>(gpu, "powers", N_CHECKED)?;
    let group = kernel.bind(gpu, &[("exponents", &from), ("powers", &to)]);
    let mut commands = Commands::new(gpu);
    commands.dispatch(kernel, &group, N_CHECKED as u64 / 4);
    commands.submit();
    let powers: Vec<f32> = to.read(gpu, N_CHECKED)?;
    let errors = exponents.iter().zip(powers).map(|(x, power)| {
        let exact = f64::from(*x).exp2();
        let ulp = (exact.log2().floor() - 23.0).exp2();
        let error = (f64::from(power) - exact).abs() / ulp;
        if error.is_nan() { f64::INFINITY } else { error }
    });
    Ok(errors.fold(0.0, f64::max))
}
