//! (pixel, Gaussian) evaluations that the forward rasterizer makes: its own source, told to write
//! how many pairs each tile walks where it would write the last blended one.

use gspotential::doctor::view::timed_case;
use gspotential::doctor::{Context, Rig};
use gspotential::error::Result;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::constants::{TILE_H, TILE_W};
use gspotential::gpu::{Commands, Gpu, Profile, shader};
use gspotential::render::{LossUniform, Pass, ViewUniform};

use super::clock::of_gpu;

/// Additions and multiplications of one evaluation, as `rasterize.wgsl` and `shared/tile.wgsl` write
/// them a pixel: 2 of `t_x`, 2 of the exponent, 13 of `2^x`, 1 of alpha, 2 of the transmittance, 1
/// of the weight, 6 of the colour, 1 of `any_open`. Comparisons, selections and what is shared by a
/// row are not counted.
pub const OPERATIONS: f64 = 28.0;

/// The rasterizer that counts.
pub struct Counting(Context);

/// The rasterizer among the stages.
pub const RASTERIZE: &str = "rasterize";

/// A stage and how it is recorded.
type Stage = (&'static str, fn(&Pass<'_>, &mut Commands<'_>));

const N_STAGES: usize = 10;

/// The stages of a view in an order in which each finds what it needs, but for the loss gradient,
/// which is 0.
const STAGES: [Stage; N_STAGES] = [
    ("project", |pass, commands| pass.project(commands)),
    ("sort by depth", |pass, commands| {
        pass.sort_by_depth(commands);
    }),
    ("counting pairs", |pass, commands| {
        pass.count_pairs(commands);
        pass.scan_pairs(commands);
    }),
    ("emitting pairs", |pass, commands| pass.emit_pairs(commands)),
    ("sort by tile", |pass, commands| pass.sort_by_tile(commands)),
    ("tile ranges and order", |pass, commands| {
        pass.find_tile_ranges(commands);
        pass.order_tiles(commands);
    }),
    (RASTERIZE, |pass, commands| pass.rasterize(commands)),
    ("loss and its gradient", |pass, commands| {
        pass.loss(commands, LossUniform::new(0.0, 0.2, 1.0, false));
    }),
    ("rasterize backward", |pass, commands| {
        pass.rasterize_backward(commands);
    }),
    ("project backward", |pass, commands| {
        pass.project_backward(commands)
    }),
];

/// One view.
pub struct Counted {
    pub evaluations: f64,
    /// (tile, Gaussian) pairs that its tiles list.
    pub pairs: f64,
    /// Seconds of the stages as they are.
    pub stages: [(&'static str, f64); N_STAGES],
}

impl Counting {
    /// # Errors
    /// A kernel that the driver refuses.
    ///
    /// # Panics
    /// If the counts of a small case cannot be.
    pub fn new(plain: &Context) -> Result<Counting> {
        let counting = Counting(Context::from_sources(Gpu::open()?, &source)?);
        counting.check(plain)?;
        Ok(counting)
    }

    /// Counts what the rasterizer evaluates over `gaussians` in `view`, and times all stages.
    ///
    /// # Errors
    /// A GPU fault.
    pub fn measure(
        &self,
        plain: &Context,
        gaussians: &Gaussians,
        view: ViewUniform,
        rounds: u32,
    ) -> Result<Counted> {
        let degree = gaussians.sh_degree;
        let mut counting = Rig::new(&self.0, gaussians, view, degree)?;
        counting.forward(&self.0)?;
        let walked: Vec<u32> = counting.read(&self.0, "last_blended", 4 * view.plane_len())?;
        let ranges: Vec<[u32; 2]> = counting.read(&self.0, "tile_ranges", view.n_tiles())?;
        drop(counting);
        let mut rig = Rig::new(plain, gaussians, view, degree)?;
        rig.forward(plain)?;
        let mut profile = Profile::new(&plain.gpu);
        let mut stages = STAGES.map(|(stage, _)| (stage, f64::INFINITY));
        for _ in 0..rounds.max(1) {
            for ((_, least), (_, record)) in stages.iter_mut().zip(STAGES) {
                let pass = rig.pass(plain);
                let seconds = of_gpu(&plain.gpu, &mut profile, |commands| {
                    record(&pass, commands);
                })?;
                *least = least.min(seconds);
            }
        }
        Ok(Counted {
            pairs: ranges.iter().map(|r| f64::from(r[1] - r[0])).sum(),
            stages,
            evaluations: walked.iter().map(|n| f64::from(*n)).sum(),
        })
    }

    /// Counts lie between the last blended pair and all pairs of their tile, reach both, and the
    /// image is the same to the bit.
    fn check(&self, plain: &Context) -> Result<()> {
        let case = timed_case();
        let mut counting = Rig::of_twin(&self.0, &case.gaussians, &case.camera)?;
        let mut rig = Rig::of_twin(plain, &case.gaussians, &case.camera)?;
        let images = (counting.forward(&self.0)?, rig.forward(plain)?);
        assert!(images.0 == images.1, "counting changes the image");
        let len = 4 * rig.view.plane_len();
        let walked: Vec<u32> = counting.read(&self.0, "last_blended", len)?;
        let last: Vec<u32> = rig.read(plain, "last_blended", len)?;
        let ranges: Vec<[u32; 2]> = rig.read(plain, "tile_ranges", rig.view.n_tiles())?;
        let listed: u64 = ranges.iter().map(|r| u64::from(r[1] - r[0])).sum();
        let pixels = u64::from(TILE_W * TILE_H);
        let walked_all: u64 = walked.iter().map(|n| u64::from(*n)).sum();
        assert!(
            walked
                .iter()
                .zip(&last)
                .all(|(walked, last)| walked >= last)
        );
        assert!(
            walked
                .iter()
                .zip(&last)
                .any(|(walked, last)| walked == last)
        );
        assert!(
            walked_all > 0 && walked_all <= pixels * listed,
            "{walked_all} of {listed}"
        );
        Ok(())
    }
}

fn source(stage: &str, sh_degree: u32) -> String {
    let mut source = shader::compose(stage, sh_degree);
    if stage != "rasterize" {
        return source;
    }
    let (start, row) = (
        "let range = tile_ranges[tile];",
        "let number = vec4u(i - range.x + 1u);",
    );
    for (from, to) in [
        (start, format!("{start}\n    var walked = vec4u(0u);")),
        (row, format!("{row}\n        walked = number;")),
    ] {
        assert!(source.contains(from), "no `{from}`");
        source = source.replace(from, &to);
    }
    for r in 0..TILE_H {
        let (from, to) = (format!("= last_{r};"), "= walked;".to_owned());
        assert!(source.contains(&from), "no `{from}`");
        source = source.replace(&from, &to);
    }
    source
}
