//! What the adapter computes at most: chains of multiplications and additions without memory.

use std::fmt::Write;

use gspotential::error::Result;
use gspotential::gpu::{Buffer, Gpu, Kernel, Profile};

use super::clock::of_gpu;

const THREADS: usize = 1 << 14;
/// Independent chains of `vec4f` a thread: with the factors, as many as 16 vector registers hold.
const CHAINS: usize = 3;
/// Links that are written out, and how often they are gone through.
const LINKS: usize = 16;
const TURNS: usize = 512;

/// The most additions and multiplications a second of several rounds; of one core where the adapter
/// is software.
///
/// # Errors
/// A GPU fault.
///
/// # Panics
/// If what is computed is wrong.
pub fn measure(gpu: &Gpu, rounds: u32) -> Result<f64> {
    let kernel = Kernel::from_source(gpu, "peak", "peak", source());
    let input = Buffer::storage_from(gpu, "factors", &[[0.5_f32, 0.25, 0.0, 0.0]])?;
    let out = Buffer::storage::<[f32; 4]>(gpu, "out", THREADS)?;
    let group = kernel.bind(gpu, &[("factors", &input), ("out", &out)]);
    let mut profile = Profile::new(gpu);
    let mut best = f64::INFINITY;
    for _ in 0..rounds.max(1) + 1 {
        let seconds = of_gpu(gpu, &mut profile, |commands| {
            commands.dispatch(&kernel, &group, THREADS as u64);
        })?;
        best = best.min(seconds);
    }
    // x = x / 2 + 1 / 4 has its fixed point at 1 / 2.
    let sums: Vec<[f32; 4]> = out.read(gpu, THREADS)?;
    let right = [0.5 * CHAINS as f32; 4];
    assert!(sums.iter().all(|sum| *sum == right), "{:?}", sums[0]);
    Ok((THREADS * CHAINS * 4 * LINKS * TURNS * 2) as f64 / best)
}

fn source() -> String {
    let mut text = String::from(
        "@group(0) @binding(0) var<storage, read> factors: array<vec4f>;\n\
         @group(0) @binding(1) var<storage, read_write> out: array<vec4f>;\n\
         @compute @workgroup_size(64)\n\
         fn peak(@builtin(global_invocation_id) id: vec3u) {\n\
         let a = vec4f(factors[0].x);\nlet b = vec4f(factors[0].y);\n",
    );
    // Writing to a String cannot fail.
    for chain in 0..CHAINS {
        let _ = writeln!(text, "var c{chain} = vec4f(f32(id.x % 7u) + {chain}.0);");
    }
    let _ = writeln!(text, "for (var i = 0u; i < {TURNS}u; i++) {{");
    for chain in (0..LINKS).flat_map(|_| 0..CHAINS) {
        let _ = writeln!(text, "c{chain} = c{chain} * a + b;");
    }
    let sum: Vec<String> = (0..CHAINS).map(|chain| format!("c{chain}")).collect();
    let _ = writeln!(text, "}}\nout[id.x] = {};\n}}", sum.join(" + "));
    text
}
