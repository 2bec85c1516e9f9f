//! This module writes one run's errors, view by view.

use crate::metrics::lpips::WEIGHTS_RECIPE;
use crate::metrics::{CoveredScore, Renders};
use crate::run::{Evaluation, Measured};
use crate::terminal::table::{Table, escaped, figure};

/// Returns a run's errors for each test view and, in the last row, their mean.
pub fn view_table(evaluation: &Evaluation) -> Table {
    let measured = evaluation.measured.as_ref();
    let lpips = measured.and_then(|measured| measured.lpips.as_ref());
    let lpips = lpips.map_or_else(|| "LPIPS".to_owned(), ToString::to_string);
    let mut header = vec!["view", "PSNR dB", "SSIM", &lpips];
    if evaluation.mean_masked.is_some() {
        header.extend(["masked PSNR dB", "masked SSIM", "masked LPIPS"]);
    }
    if evaluation.mean_covered.is_some() {
        header.extend(["covered PSNR dB", "covered %"]);
    }
    let mut table = Table::new(&header);
    for view in &evaluation.views {
        let masked = view.masked.as_ref();
        let mut row = vec![view.name.clone()];
        row.extend(figures(view.psnr, view.ssim, view.lpips));
        if evaluation.mean_masked.is_some() {
            row.extend(figures(
                masked.and_then(|m| m.psnr),
                masked.and_then(|m| m.ssim),
                masked.and_then(|m| m.lpips),
            ));
        }
        row.extend(view.covered.iter().flat_map(covered_figures));
        table.row(&row);
    }
    let mean = &evaluation.mean;
    let mut row = vec![format!("**mean of {}**", evaluation.views.len())];
    row.extend(figures(mean.psnr, mean.ssim, mean.lpips));
    if let Some(masked) = &evaluation.mean_masked {
        let mean = masked.mean;
        row.extend(figures(mean.psnr, mean.ssim, mean.lpips));
    }
    row.extend(evaluation.mean_covered.iter().flat_map(covered_figures));
    table.row(&row);
    table
}

/// Returns a run's errors, its size and training time, in Markdown.
pub fn evaluation_table(run: &str, evaluation: &Evaluation) -> String {
    let table = view_table(evaluation);
    let mut out = format!(
        "### {}\n\n{table}\n{} Gaussians, trained in {} s\n",
        escaped(run),
        evaluation.n_gaussians,
        figure(evaluation.train_s, 1)
    );
    if let Some(splat) = &evaluation.point_splat {
        out += &format!(
            "\nBare point splat of the cloud: {} dB, SSIM {}; {} dB on the {:.1} % of the pixels \
             that it covers\n",
            figure(splat.psnr, 2),
            figure(splat.ssim, 4),
            figure(splat.psnr_covered, 2),
            100.0 * splat.coverage
        );
    }
    if let Some(masked) = &evaluation.mean_masked {
        let (n, all) = (masked.n_views, evaluation.views.len());
        out += &format!("\n{}; {n} of {all} views have one\n", MASKED);
    }
    if evaluation.mean_covered.is_some() {
        out += &format!("\n{COVERED}\n");
    }
    if let Some(measured) = &evaluation.measured {
        out += &format!("\n{}\n", how(measured));
        if measured.lpips.is_none() {
            out += &format!("\n{}\n", lpips_hint());
        }
    }
    out
}

/// What the masked columns are.
pub(super) const MASKED: &str = "Masked: PSNR of the mask's pixels, SSIM's map averaged over \
     them, LPIPS of both images black beyond the mask";

/// What the covered columns are.
pub(super) const COVERED: &str = "Covered: PSNR of the pixels on which the bare splat of the \
     scene's whole cloud puts a point, the same pixels for every run, and their share";

/// Says how figures were measured.
pub(super) fn how(measured: &Measured) -> String {
    let renders = match measured.renders {
        Renders::Rounded => "Renders are rounded to 8 bit",
        Renders::Float => "Renders are measured as floats, not rounded to 8 bit",
    };
    format!("{renders}. Test cameras: {}.", measured.pose_protocol)
}

/// Says how a user comes by LPIPS if it was left out.
pub(super) fn lpips_hint() -> String {
    format!(
        "LPIPS is n/a: --lpips-weights FILE measures it; make the file once: `{WEIGHTS_RECIPE}`"
    )
}

fn covered_figures(covered: &CoveredScore) -> [String; 2] {
    let percent = format!("{:.1}", 100.0 * covered.coverage);
    [figure(covered.psnr, 2), percent]
}

fn figures(psnr: Option<f64>, ssim: Option<f64>, lpips: Option<f64>) -> [String; 3] {
    [figure(psnr, 2), figure(ssim, 4), figure(lpips, 4)]
}
