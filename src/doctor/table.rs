//! The report as Markdown.

use std::fmt;

use super::{Adapter, RasterizerReport, Report, StageReport};
use crate::gpu::Rasterizer;
use crate::report::{Column, Table};

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "### Adapter\n\n{}", adapter_table(&self.adapter))?;
        writeln!(f, "### Stages\n\n{}", stage_table(&self.stages))?;
        let n: usize = self.stages.iter().map(|stage| stage.n_findings).sum();
        writeln!(
            f,
            "Each row shows, of all comparisons of its stage ({n} in all), the one that comes \
             closest to its bound. Bound 0: integers, which agree exactly."
        )?;
        let clock = if self.adapter.timestamps {
            "Times are the adapter's timestamps; with *, wall-clock time."
        } else {
            "The adapter has no timestamps: times are wall-clock time, submission included."
        };
        writeln!(f, "{clock} They are those of the fastest round.\n")?;
        for report in &self.rasterizers {
            write_rasterizer(f, report)?;
        }
        if let Some((rule, other)) = self.faster_than_the_rule() {
            writeln!(
                f,
                "\nThe rule is wrong here, at this size: `{other}` is faster than `{rule}`; train with \
                 `--set render.rasterizer={other}`."
            )?;
        }
        Ok(())
    }
}

fn write_rasterizer(f: &mut fmt::Formatter<'_>, report: &RasterizerReport) -> fmt::Result {
    let RasterizerReport {
        rasterizer,
        is_rule,
        view_seconds,
        repeat,
    } = report;
    writeln!(
        f,
        "Rasterizer `{}`{}: {:.2} ms a view; trained twice with one seed, {} iterations: {} and {}, {}",
        rasterizer,
        if *is_rule { ", this adapter's" } else { "" },
        1e3 * view_seconds,
        repeat.iterations,
        repeat.hashes[0],
        repeat.hashes[1],
        if repeat.holds {
            "equal to the bit"
        } else {
            "**different**"
        }
    )
}

impl Report {
    /// Returns the rule's rasterizer and the fastest, where that is another by more than a tenth: less is noise.
    fn faster_than_the_rule(&self) -> Option<(Rasterizer, Rasterizer)> {
        let rule = self.rasterizers.iter().find(|r| r.is_rule)?;
        let by_time = |a: &&RasterizerReport, b: &&RasterizerReport| {
            a.view_seconds.total_cmp(&b.view_seconds)
        };
        let fastest = self.rasterizers.iter().min_by(by_time)?;
        let is_other = fastest.view_seconds < 0.9 * rule.view_seconds;
        is_other.then_some((rule.rasterizer, fastest.rasterizer))
    }
}

fn adapter_table(adapter: &Adapter) -> Table {
    let columns = [
        Column::text("what", "adapter"),
        Column::quantity("value", "").headed(adapter.name.clone()),
        Column::quantity("needed", "needed"),
    ];
    let mut table = Table::new("adapter", &columns);
    let mut row = |name: &str, value: String, needed: &str| {
        table.row([name.into(), value.into(), needed.into()]);
    };
    row("driver", adapter.driver.clone(), "");
    row(
        "backend",
        format!("{}, {}", adapter.backend, adapter.kind),
        "",
    );
    let mib = |bytes: u64| format!("{} MiB", bytes >> 20);
    row("largest buffer", mib(adapter.max_buffer_bytes), "");
    row("largest binding", mib(adapter.max_binding_bytes), "");
    row(
        "- Gaussians of SH degree 3",
        grouped(adapter.most_gaussians as u64),
        "",
    );
    row("- (tile, Gaussian) pairs", grouped(adapter.most_pairs), "");
    for limit in &adapter.limits {
        row(
            limit.name,
            limit.adapter.to_string(),
            &limit.needed.to_string(),
        );
    }
    let yes = |has: bool| if has { "yes" } else { "no" }.to_owned();
    row("timestamps", yes(adapter.timestamps), "for times");
    let subgroups = match adapter.subgroups {
        Some([min, max]) if min == max => format!("{min} threads"),
        Some([min, max]) => format!("{min} to {max} threads"),
        None => "no".to_owned(),
    };
    row("subgroups", subgroups, "not used");
    row("half floats", yes(adapter.half_floats), "not used");
    table
}

fn stage_table(stages: &[StageReport]) -> Table {
    let columns = [
        Column::text("stage", "stage"),
        Column::quantity("size", "size"),
        Column::quantity("time", "time"),
        Column::quantity("throughput", "throughput"),
        Column::quantity("error", "error"),
        Column::quantity("bound", "bound"),
        Column::quantity("worst", "worst at"),
        Column::quantity("verdict", "verdict"),
    ];
    let mut table = Table::new("stages", &columns);
    for stage in stages {
        let (error, bound, at) = match &stage.worst {
            Some(worst) if worst.error == 0.0 => ("0".into(), number(worst.bound), String::new()),
            Some(worst) => (
                number(worst.error),
                number(worst.bound),
                format!("{}, {}", worst.case, worst.what),
            ),
            None => ("n/a".into(), "n/a".into(), "nothing compared".into()),
        };
        let mark = if stage.by_timestamps { "" } else { "*" };
        let rate = stage.count as f64 / stage.seconds;
        table.row([
            stage.stage.into(),
            format!("{} {}", grouped(stage.count as u64), stage.unit).into(),
            format!("{:.2} ms{mark}", 1e3 * stage.seconds).into(),
            format!("{} M/s", significant(1e-6 * rate)).into(),
            error.into(),
            bound.into(),
            at.into(),
            if stage.holds { "ok" } else { "**FAILED**" }.into(),
        ]);
    }
    table
}

/// Writes a number: whole as it is, else two digits.
fn number(x: f64) -> String {
    match x {
        0.0 => "0".to_owned(),
        x if x == x.round() && x.abs() < 1e6 => format!("{x}"),
        x if x.is_finite() => format!("{x:.1e}"),
        _ => "not finite".to_owned(),
    }
}

/// Writes three significant digits or a whole number.
fn significant(x: f64) -> String {
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 3.0);
    format!("{x:.*}", decimals as usize)
}

/// Writes digits in groups of three.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}
