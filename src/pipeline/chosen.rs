//! This module says in words what a run has chosen for its scene, and why.

use crate::config::Config;
use crate::train::length::Settling;
use crate::train::schedule::sh_degree;
use crate::train::{Lowering, SignalPoint, Trim};

/// Writes a sentence for everything that was chosen; none where all was stated.
pub(super) fn chosen(
    n_virtual: usize,
    iterations: u32,
    signal: &[SignalPoint],
    trims: &[Trim],
    config: &Config,
) -> Vec<String> {
    let need = &config.need;
    let mut sentences = Vec::new();
    let most = config.views.count;
    if let Some(within) = config.views.within_deg.filter(|_| n_virtual < most) {
        sentences.push(format!(
            "{n_virtual} virtual views of {most}: nearly all directions that show what photographs see lie within {within} \
             degrees of one (views.within_deg)"
        ));
    }
    if need.ends {
        sentences.push(length(iterations, signal, config));
        let Settling { from, .. } = Settling::of(config, signal);
        let degree = sh_degree(config, iterations.saturating_sub(1).min(from));
        if degree < config.model.sh_degree {
            sentences.push(format!(
                "SH degree {degree} of {}: one more begins every {} iterations (model.sh_interval) until \
                 the learning rates fall",
                config.model.sh_degree, config.model.sh_interval
            ));
        }
    }
    let pruned = |trim: &Trim| need.prune || trim.over_budget > 0;
    let trims: Vec<&Trim> = trims.iter().filter(|trim| pruned(trim)).collect();
    if let (Some(first), Some(last)) = (trims.first(), trims.last()) {
        let steps = trims
            .iter()
            .map(|trim| trimmed(trim))
            .collect::<Vec<_>>()
            .join("; ");
        sentences.push(format!(
            "{} Gaussians of {}: {steps} (need.tolerance_db {})",
            last.n_after, first.n_before, need.tolerance_db
        ));
    }
    sentences
}

/// Writes the sentence for SH degrees that were lowered.
pub(super) fn lowered(lowering: &Lowering) -> String {
    let Lowering {
        of_degree,
        allowed_db,
        cost_db,
    } = lowering;
    let [zero, one, two, three] = of_degree;
    format!(
        "SH degrees: {zero} Gaussians have 0, {one} have 1, {two} have 2, {three} have 3; what showed least went at a cost of \
         {cost_db:.3} dB, where {allowed_db:.3} were allowed"
    )
}

fn length(iterations: u32, signal: &[SignalPoint], config: &Config) -> String {
    if signal.is_empty() {
        return format!(
            "{iterations} iterations: no virtual view is held out that could end them before"
        );
    }
    let Settling { from, until } = Settling::of(config, signal);
    if until == config.iterations {
        return format!(
            "{iterations} iterations, the most that there may be (iterations): the held-out views were still \
             rising"
        );
    }
    let measured = signal.iter().find(|point| point.iteration == from);
    let psnr = measured.map_or(String::new(), |point| {
        format!(" at {:.2} dB", point.held_out)
    });
    format!(
        "{iterations} iterations: after {from}, the last third had brought the held-out views less than \
         {} dB (need.least_gain_db){psnr}, and learning rates fell from there",
        config.need.least_gain_db
    )
}

fn trimmed(trim: &Trim) -> String {
    let Trim {
        iteration,
        n_before,
        n_after,
        ..
    } = trim;
    if trim.over_budget > 0 {
        return format!(
            "{} pruned after {iteration}, {} of them for the file to fit (need.max_mb): {:.3} dB at once, \
             where {:.3} were allowed, so that the scene needs more",
            n_before - n_after,
            trim.over_budget,
            trim.cost_db,
            trim.allowed_db
        );
    }
    if n_after == n_before {
        return format!(
            "none pruned after {iteration}, for {:.3} dB no share worth it could go",
            trim.allowed_db
        );
    }
    format!(
        "{} pruned after {iteration}, which contributed {:.2} % and cost {:.3} dB at once",
        n_before - n_after,
        100.0 * trim.contribution,
        trim.cost_db
    )
}
