//! Measures what each kernel costs before it first runs: its pipeline, and its first dispatch, in which drivers on a CPU make
//! machine code.
//!
//! `MESA_SHADER_CACHE_DISABLE=true cargo bench --bench compile -- [--stage NAME]`
//!
//! Kernels run over zeros, one after the other.

use std::time::Instant;

use clap::Parser;
use gspotential::error::Result;
use gspotential::gpu::{Gpu, Stage, shader, try_out};
use gspotential::report::{Column, Table};

const COLUMNS: [Column; 4] = [
    Column::text("shader", "shader"),
    Column::text("kernel", "kernel"),
    Column::number("pipeline_s", "pipeline, s", 3),
    Column::number("first_s", "with the first dispatch, s", 3),
];

#[derive(Parser)]
struct Args {
    /// Only shaders whose names begin so.
    #[arg(long, default_value = "")]
    stage: String,
    /// Cargo passes this flag.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let gpu = Gpu::open()?;
    let mut rows = Vec::new();
    let programs = shader::programs().into_iter();
    for (name, source) in programs.filter(|(name, _)| name.starts_with(&args.stage)) {
        let entries = entry_points(&source);
        let stage = Stage::new(&name, source);
        for entry in entries {
            let kernel = stage.kernel(entry);
            let begin = Instant::now();
            try_out(&gpu, &kernel);
            let pipeline_s = begin.elapsed().as_secs_f64();
            gpu.wait()?;
            rows.push((
                begin.elapsed().as_secs_f64(),
                pipeline_s,
                name.clone(),
                entry,
            ));
        }
    }
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut table = Table::new("compile", &COLUMNS);
    for (first_s, pipeline_s, name, entry) in rows {
        table.row([
            name.into(),
            entry.to_owned().into(),
            pipeline_s.into(),
            first_s.into(),
        ]);
    }
    print!("{table}");
    Ok(())
}

/// Returns the names of a shader's kernels, for as long as the program runs.
fn entry_points(source: &str) -> Vec<&'static str> {
    let module = naga::front::wgsl::parse_str(source).expect("the program's shaders parse");
    let points = module.entry_points.into_iter();
    points.map(|point| &*point.name.leak()).collect()
}
