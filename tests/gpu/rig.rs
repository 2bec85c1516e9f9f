//! One adapter and one set of kernels for all tests, and assertions over what the doctor finds.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use gspotential::config::RasterizerChoice;
use gspotential::doctor::twin::compare::held_l2;
use gspotential::doctor::{Context, Findings};
use gspotential::gpu::shader::compose;
use gspotential::gpu::{Gpu, Rasterizer};

fn open() -> Gpu {
    Gpu::open().unwrap_or_else(|e| panic!("{e}"))
}

/// The adapter with the rasterizer that the rule gives it, for one test at a time: memory stays bounded
/// and a fault belongs to its test. No adapter is a failure, never a skip.
pub(crate) fn context() -> MutexGuard<'static, Context> {
    static RULE: OnceLock<Rasterizer> = OnceLock::new();
    context_of(*RULE.get_or_init(|| Rasterizer::of(RasterizerChoice::Auto, &open())))
}

/// The adapter with this rasterizer. Who takes two takes them in the order of [`Rasterizer::ALL`].
pub(crate) fn context_of(rasterizer: Rasterizer) -> MutexGuard<'static, Context> {
    static CONTEXTS: [OnceLock<Mutex<Context>>; 2] = [const { OnceLock::new() }; 2];
    let place = Rasterizer::ALL.iter().position(|r| *r == rasterizer);
    CONTEXTS[place.expect("is one of all")]
        .get_or_init(|| Mutex::new(Context::from_sources(open(), rasterizer, &compose)))
        .lock()
        // What another test has failed with is its own.
        .unwrap_or_else(PoisonError::into_inner)
}

/// Fails where a finding is out of bounds, and where there is none. Returns the largest error as
/// a share of its bound.
pub(crate) fn assert_findings(findings: &Findings) -> f64 {
    assert!(!findings.list.is_empty(), "nothing was compared");
    let bad: Vec<_> = findings.list.iter().filter(|f| !f.holds()).collect();
    assert!(bad.is_empty(), "{bad:#?}");
    findings
        .list
        .iter()
        .map(|f| f.severity())
        .fold(0.0, f64::max)
}

/// Fails where `ours` is not the twin's within `tolerance` (relative L2), and where the comparison
/// could not have failed.
pub(crate) fn assert_held(what: &str, ours: &[f64], twin: &[f64], tolerance: f64) {
    let error = held_l2(ours, twin, tolerance);
    assert!(
        error <= tolerance,
        "{what}: relative L2 {error:e} > {tolerance:e}"
    );
}
