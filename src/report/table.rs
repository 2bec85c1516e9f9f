//! Markdown tables.

use std::fmt::{self, Write as _};

use crate::run::Evaluation;

/// A Markdown table. The first column is aligned to the left, the others, figures, to the right.
#[derive(Clone, Debug)]
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new(header: &[&str]) -> Table {
        Table {
            rows: vec![header.iter().map(|&cell| cell.to_owned()).collect()],
        }
    }

    /// Appends a row; cells beyond the header's are left out, missing ones are empty.
    pub fn row(&mut self, cells: &[String]) {
        let mut row = cells.to_vec();
        row.resize(self.rows[0].len(), String::new());
        self.rows.push(row);
    }

    /// The header and the rows, as they came.
    pub fn rows(&self) -> &[Vec<String>] {
        &self.rows
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let escape = |row: &Vec<String>| row.iter().map(|cell| escaped(cell)).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().map(escape).collect();
        let n_columns = rows[0].len();
        let widths: Vec<usize> = (0..n_columns)
            .map(|column| {
                let widths = rows.iter().map(|row| row[column].chars().count());
                widths.max().unwrap_or(0).max(3)
            })
            .collect();
        for (i, row) in rows.iter().enumerate() {
            for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                if column == 0 {
                    write!(f, "| {cell:width$} |")?;
                } else {
                    write!(f, " {cell:>width$} |")?;
                }
            }
            f.write_char('\n')?;
            if i == 0 {
                for (column, &width) in widths.iter().enumerate() {
                    if column == 0 {
                        write!(f, "|{}|", "-".repeat(width + 2))?;
                    } else {
                        write!(f, "{}:|", "-".repeat(width + 1))?;
                    }
                }
                f.write_char('\n')?;
            }
        }
        Ok(())
    }
}

/// Names come from files: what would break the table or reach the terminal raw is replaced.
fn escaped(cell: &str) -> String {
    cell.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect::<String>()
        .replace('\\', "\\\\")
        .replace('|', "\\|")
}

/// A run's errors per test view and, in the last row, in the mean.
pub fn view_table(evaluation: &Evaluation) -> Table {
    let mut table = Table::new(&["view", "PSNR dB", "SSIM", "LPIPS"]);
    for view in &evaluation.views {
        table.row(&[
            view.name.clone(),
            figure(view.psnr, 2),
            figure(view.ssim, 4),
            figure(view.lpips, 4),
        ]);
    }
    let mean = &evaluation.mean;
    table.row(&[
        format!("**mean of {}**", evaluation.views.len()),
        figure(mean.psnr, 2),
        figure(mean.ssim, 4),
        figure(mean.lpips, 4),
    ]);
    table
}

/// A run's errors, its size and training time, in Markdown.
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
    out
}

/// `n/a` for what was not measured.
pub(super) fn figure(value: Option<f64>, digits: usize) -> String {
    match value {
        Some(value) => format!("{value:.digits$}"),
        None => "n/a".to_owned(),
    }
}
