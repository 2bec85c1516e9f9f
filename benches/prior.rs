//! Time and memory of the network that finds depth and cameras, with random weights of full size.
//!
//! `cargo bench --bench prior -- --tensors FILE [--views N] [--size WIDTHxHEIGHT] [--keep DIR]`
//!
//! FILE has a line `NAME AxBxC` for each tensor of a model. With `--keep`, `DIR/model.safetensors`,
//! and `images.f32` and `depth.f32` (`[views][3][height][width]`, `[views][height][width]`) let another
//! program do the same.

mod kit;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use gspotential::error::{Error, Result};
use gspotential::prior::{Images, Network, Outputs, memory};
use gspotential::run::peak_host_bytes;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde_json::{Map, json};

use kit::{Size, cpu_s};

#[derive(Parser)]
struct Args {
    /// Names and shapes of a model's tensors
    #[arg(long)]
    tensors: PathBuf,
    #[arg(long, default_value_t = 4)]
    views: usize,
    /// Width and height of the images, multiples of 14
    #[arg(long, default_value = "504x378")]
    size: Size,
    /// Folder for weights, images and depths
    #[arg(long)]
    keep: Option<PathBuf>,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let (width, height) = args.size.pixels;
    let temporary = tempfile::tempdir().map_err(failed)?;
    let folder = args.keep.as_deref().unwrap_or(temporary.path());
    std::fs::create_dir_all(folder).map_err(failed)?;
    let path = folder.join("model.safetensors");
    write_weights(&path, &tensors(&args.tensors)?).map_err(failed)?;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let n = args.views * 3 * width as usize * height as usize;
    let values: Vec<f32> = (0..n).map(|_| StandardNormal.sample(&mut rng)).collect();
    if args.keep.is_some() {
        write_floats(&folder.join("images.f32"), &values).map_err(failed)?;
    }
    let images = Images::from_values(values, height, width)?;

    let (start, cpu) = (Instant::now(), cpu_s());
    let network = Network::read(&path, Outputs::Depth)?;
    let (read, read_cpu) = (start.elapsed().as_secs_f64(), since(cpu));
    let (start, cpu) = (Instant::now(), cpu_s());
    let found = network.predict(&images, None, &mut |_, _| {});
    let (wall, wall_cpu) = (start.elapsed().as_secs_f64(), since(cpu));
    let depth: Vec<f32> = found.views.iter().flat_map(|v| &v.depth).copied().collect();
    // Random weights may do anything; what is not finite would be the time of something else.
    let is_right = depth.iter().all(|d| *d > 0.0 && d.is_finite());
    assert!(is_right, "depths are above 0 and finite");
    if args.keep.is_some() {
        write_floats(&folder.join("depth.f32"), &depth).map_err(failed)?;
    }
    let mb = |bytes: u64| bytes as f64 / 1e6;
    let predicted = memory(
        network.model(),
        args.views,
        (width, height),
        rayon::current_num_threads(),
    );
    println!(
        "{}, {} views of {width}x{height}: {wall:.1} s wall, {wall_cpu} CPU s; weights read in {read:.1} s, \
         {read_cpu} CPU s; {} threads, peak {:.0} MB, predicted {:.0} MB",
        network.model().name(),
        args.views,
        rayon::current_num_threads(),
        mb(peak_host_bytes().unwrap_or(0)),
        mb(predicted.total()),
    );
    Ok(())
}

fn failed(e: std::io::Error) -> Error {
    Error::new(e.to_string())
}

fn tensors(path: &Path) -> Result<Vec<(String, Vec<usize>)>> {
    let text = std::fs::read_to_string(path).map_err(|e| failed(e).at_path(path))?;
    let parsed = |line: &str| {
        let (name, shape) = line.split_once(' ')?;
        let sides: std::result::Result<_, _> = shape.trim().split('x').map(str::parse).collect();
        Some((name.to_owned(), sides.ok()?))
    };
    text.lines()
        .map(|line| {
            parsed(line).ok_or_else(|| {
                Error::new(format!("`{line}` is not a name and a shape")).at_path(path)
            })
        })
        .collect()
}

/// Weights such that values keep their size from layer to layer.
fn write_weights(path: &Path, tensors: &[(String, Vec<usize>)]) -> std::io::Result<()> {
    let (mut header, mut end) = (Map::new(), 0);
    for (name, shape) in tensors {
        let begin = end;
        end += 4 * shape.iter().product::<usize>();
        let entry = json!({"dtype": "F32", "shape": shape, "data_offsets": [begin, end]});
        header.insert(name.clone(), entry);
    }
    let header = serde_json::Value::Object(header).to_string();
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(&(header.len() as u64).to_le_bytes())?;
    file.write_all(header.as_bytes())?;
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    for (name, shape) in tensors {
        let n_in: usize = shape[1..].iter().product();
        let (mean, deviation) = match shape.len() {
            1 if name.ends_with("gamma") => (0.1, 0.01),
            1 if name.ends_with("weight") => (1.0, 0.1),
            1 => (0.0, 0.02),
            _ if name.ends_with("weight") => (0.0, 1.0 / (n_in as f32).sqrt()),
            _ => (0.0, 0.02),
        };
        for _ in 0..shape.iter().product() {
            let normal: f32 = StandardNormal.sample(&mut rng);
            file.write_all(&(mean + deviation * normal).to_le_bytes())?;
        }
    }
    file.flush()
}

fn write_floats(path: &Path, values: &[f32]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    for value in values {
        file.write_all(&value.to_le_bytes())?;
    }
    file.flush()
}

/// User and system time since `before`, where the system tells.
fn since(before: Option<f64>) -> String {
    let passed = cpu_s().zip(before).map(|(after, before)| after - before);
    passed.map_or("?".to_owned(), |s| format!("{s:.1}"))
}
