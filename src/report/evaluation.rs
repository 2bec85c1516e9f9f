//! This module writes one run's errors, view by view.

use super::table::{Cell, Column, Table, escaped, figure};
use crate::metrics::lpips::WEIGHTS_RECIPE;
use crate::metrics::{CoveredScore, Renders};
use crate::run::{Evaluation, Measured};

/// Returns a run's errors for each test view and, in the last row, their mean.
pub fn view_table(evaluation: &Evaluation) -> Table {
    let measured = evaluation.measured.as_ref();
    let lpips = measured.and_then(|measured| measured.lpips.as_ref());
    let lpips = lpips.map_or_else(|| "LPIPS".to_owned(), ToString::to_string);
    let mut columns = vec![
        Column::text("view", "view"),
        Column::number("psnr", "PSNR dB", 2),
        Column::number("ssim", "SSIM", 4),
        Column::number("lpips", "LPIPS", 4).headed(lpips),
    ];
    let fitted = evaluation.mean_fitted_psnr;
    columns.extend(fitted.map(|_| Column::number("fitted_psnr", "fitted PSNR dB", 2)));
    if evaluation.mean_masked.is_some() {
        columns.extend([
            Column::number("masked_psnr", "masked PSNR dB", 2),
            Column::number("masked_ssim", "masked SSIM", 4),
            Column::number("masked_lpips", "masked LPIPS", 4),
        ]);
    }
    if evaluation.mean_covered.is_some() {
        columns.extend([
            Column::number("covered_psnr", "covered PSNR dB", 2),
            Column::number("covered_percent", "covered %", 1),
        ]);
    }
    let mut table = Table::new("views", &columns);
    for view in &evaluation.views {
        let masked = view.masked.as_ref();
        let mut row: Vec<Cell> = vec![(&view.name).into()];
        row.extend([view.psnr, view.ssim, view.lpips].map(Cell::from));
        row.extend(fitted.map(|_| Cell::from(view.fitted_psnr)));
        if evaluation.mean_masked.is_some() {
            row.extend([
                masked.and_then(|m| m.psnr).into(),
                masked.and_then(|m| m.ssim).into(),
                masked.and_then(|m| m.lpips).into(),
            ]);
        }
        row.extend(view.covered.iter().flat_map(covered_cells));
        table.row(row);
    }
    let mean = &evaluation.mean;
    let mut row: Vec<Cell> = vec![format!("**mean of {}**", evaluation.views.len()).into()];
    row.extend([mean.psnr, mean.ssim, mean.lpips].map(Cell::from));
    row.extend(fitted.map(|_| Cell::from(fitted)));
    if let Some(masked) = &evaluation.mean_masked {
        let mean = masked.mean;
        row.extend([mean.psnr, mean.ssim, mean.lpips].map(Cell::from));
    }
    row.extend(evaluation.mean_covered.iter().flat_map(covered_cells));
    table.row(row);
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
    if evaluation.mean_fitted_psnr.is_some() {
        out += &format!("\n{FITTED}\n");
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

/// What the fitted column is.
pub(super) const FITTED: &str = "Fitted: PSNR after the best 3x4 colour matrix for each view, which looks at its \
     photograph: what it gains is exposure and white balance";

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

fn covered_cells(covered: &CoveredScore) -> [Cell; 2] {
    [covered.psnr.into(), (100.0 * covered.coverage).into()]
}
