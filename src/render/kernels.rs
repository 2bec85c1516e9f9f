//! The kernels of a view and their bind groups.

use rayon::prelude::*;

use super::model::Model;
use super::workspace::Workspace;
use crate::config::{RasterizerChoice, RenderConfig};
use crate::error::Result;
use crate::gpu::constants::{SCAN_CHUNK, SCAN_FEW, WORKGROUP};
use crate::gpu::shader::{self, Sources};
use crate::gpu::{Buffer, Exp2, Gpu, Kernel, Rasterizer, Stage, by_degree, try_out};

/// An adapter and the kernels that were made for it.
#[derive(Clone, Copy)]
pub struct Device<'a> {
    /// The adapter.
    pub gpu: &'a Gpu,
    /// Its kernels.
    pub kernels: &'a Kernels,
}

/// Every kernel that renders, compares and differentiates a view.
pub struct Kernels {
    /// The rasterizer that its stages belong to.
    pub rasterizer: Rasterizer,
    /// By active SH degree.
    pub(super) project: [Kernel; 4],
    pub(super) radix_count: Kernel,
    /// Scans counts digit by digit; none where they are scanned as other counts are.
    pub(super) radix_scan: Option<Kernel>,
    pub(super) radix_move: Kernel,
    pub(super) bin: Kernel,
    pub(super) scan_reduce: Kernel,
    pub(super) scan_spread: Kernel,
    pub(super) scan_few: Kernel,
    pub(super) find_tile_ranges: Kernel,
    pub(super) order_tiles: Kernel,
    /// Whole lists, and slices of them.
    pub(super) rasterize: [Kernel; 2],
    /// Without a mask and with one, in the order in which they run.
    pub(super) ssim: [Vec<Kernel>; 2],
    pub(super) loss_blocks: Kernel,
    pub(super) loss_total: Kernel,
    /// Whole lists, and slices of them.
    pub(super) rasterize_backward: [Kernel; 2],
    pub(super) sum_pairs: Kernel,
    pub(super) sum_gaussians: Kernel,
    pub(super) project_backward: [Kernel; 4],
}

impl Kernels {
    /// Takes the program's own shaders, with the rasterizer that the rule gives this adapter.
    pub fn new(gpu: &Gpu) -> Kernels {
        Self::with(Rasterizer::of(RasterizerChoice::Auto, gpu))
    }

    /// Takes the program's own shaders, with this rasterizer and the program's 2^x.
    pub fn with(rasterizer: Rasterizer) -> Kernels {
        Self::from_sources(rasterizer, &shader::compose)
    }

    /// Takes what a config asks for on an adapter.
    ///
    /// # Errors
    /// A GPU fault while the adapter's 2^x is checked.
    pub fn of(config: &RenderConfig, gpu: &Gpu) -> Result<Kernels> {
        let rasterizer = Rasterizer::of(config.rasterizer, gpu);
        let exp2 = Exp2::of(config.exp2, gpu)?;
        Ok(Self::from_sources(rasterizer, exp2.sources()))
    }

    /// Compiles the kernels that every training's first step runs, and has the driver make their machine code: beside work on
    /// the CPU, this costs no time of its own. Others depend on the numbers of Gaussians and pairs.
    pub fn prepare(&self, gpu: &Gpu) {
        self.of_first_step()
            .par_iter()
            .for_each(|kernel| try_out(gpu, kernel));
    }

    /// Returns the kernels that [`Kernels::prepare`] compiles.
    pub fn of_first_step(&self) -> Vec<&Kernel> {
        let mut kernels = vec![
            &self.rasterize_backward[0],
            &self.rasterize[0],
            &self.project[0],
            &self.project_backward[0],
            &self.radix_count,
            &self.radix_move,
            &self.bin,
            &self.find_tile_ranges,
            &self.order_tiles,
            &self.sum_pairs,
            &self.sum_gaussians,
        ];
        kernels.extend(&self.radix_scan);
        kernels.extend(&self.ssim[0]);
        kernels
    }

    /// Takes other sources than the program's.
    pub fn from_sources(rasterizer: Rasterizer, sources: Sources<'_>) -> Kernels {
        let stages = rasterizer.stages();
        let stage = |name: &str, degree: u32| Stage::new(name, sources(name, degree));
        let by_degree = |name: &'static str| by_degree(|degree| stage(name, degree).kernel(name));
        let [ssim, scan, radix] =
            [stages.ssim, stages.scan, stages.radix].map(|name| stage(name, 0));
        let ssim = match rasterizer {
            Rasterizer::Thread => {
                let entries = [
                    "ssim_horizontal",
                    "ssim_vertical",
                    "ssim_horizontal_backward",
                    "ssim_vertical_backward",
                ];
                let kernels: Vec<Kernel> = entries.map(|entry| ssim.kernel(entry)).into();
                [kernels.clone(), kernels]
            }
            Rasterizer::Workgroup => {
                ["ssim_march", "ssim_march_masked"].map(|entry| vec![ssim.kernel(entry)])
            }
        };
        let (tile_ranges, sum_pairs) = (stage("tile_ranges", 0), stage("sum_pairs", 0));
        let loss = stage("loss_sum", 0);
        let raster = stage(stages.rasterize, 0);
        let raster_backward = stage(stages.rasterize_backward, 0);
        Kernels {
            rasterizer,
            project: by_degree("project"),
            radix_count: radix.kernel("radix_count"),
            radix_scan: match rasterizer {
                Rasterizer::Thread => None,
                Rasterizer::Workgroup => Some(radix.kernel("radix_scan")),
            },
            radix_move: radix.kernel("radix_move"),
            bin: stage(stages.bin, 0).kernel("bin"),
            scan_reduce: scan.kernel("scan_reduce"),
            scan_spread: scan.kernel("scan_spread"),
            scan_few: scan.kernel("scan_few"),
            find_tile_ranges: tile_ranges.kernel("find_tile_ranges"),
            order_tiles: tile_ranges.kernel("order_tiles"),
            rasterize: ["rasterize", "rasterize_slice"].map(|entry| raster.kernel(entry)),
            ssim,
            loss_blocks: loss.kernel("loss_blocks"),
            loss_total: loss.kernel("loss_total"),
            rasterize_backward: ["rasterize_backward", "rasterize_backward_slice"]
                .map(|entry| raster_backward.kernel(entry)),
            sum_pairs: sum_pairs.kernel("sum_pairs"),
            sum_gaussians: sum_pairs.kernel("sum_gaussians"),
            project_backward: by_degree("project_backward"),
        }
    }
}

/// Bind groups of a workspace and a model, for both slots; bound to nothing by default.
#[derive(Default)]
pub struct Bound {
    pub(super) slots: Vec<Groups>,
}

pub(super) struct Groups {
    /// By active SH degree, up to the model's.
    pub(super) project: Vec<wgpu::BindGroup>,
    pub(super) depth_passes: Vec<RadixGroups>,
    pub(super) pair_passes: Vec<RadixGroups>,
    pub(super) bin_count: wgpu::BindGroup,
    /// Each splat's first pairs and then the rest; or all at once.
    pub(super) bin_emit: Vec<wgpu::BindGroup>,
    pub(super) scan_pairs: ScanGroups,
    pub(super) find_tile_ranges: wgpu::BindGroup,
    pub(super) order_tiles: wgpu::BindGroup,
    pub(super) rasterize: RasterGroups,
    pub(super) backward: Option<BackwardGroups>,
}

pub(super) struct RadixGroups {
    /// None where what has made the entries has counted their digits.
    pub(super) count: Option<wgpu::BindGroup>,
    pub(super) scan: DigitScan,
    pub(super) shift: wgpu::BindGroup,
}

/// Bind groups of the scan of a radix sort's counts.
pub(super) enum DigitScan {
    /// As one list.
    Counts(ScanGroups),
    /// Digit by digit, with the kernel that does so.
    Digits(Kernel, wgpu::BindGroup),
}

/// Bind groups of a scan, by the way that its most counts take.
pub(super) enum ScanGroups {
    /// For `scan_few`.
    Few(wgpu::BindGroup),
    /// For `scan_reduce` and `scan_spread`.
    Many([wgpu::BindGroup; 2]),
}

pub(super) struct BackwardGroups {
    pub(super) ssim: [Vec<wgpu::BindGroup>; 2],
    pub(super) loss_sum: [wgpu::BindGroup; 2],
    pub(super) rasterize: RasterGroups,
    pub(super) sum_pairs: wgpu::BindGroup,
    pub(super) sum_gaussians: wgpu::BindGroup,
    pub(super) project: Vec<wgpu::BindGroup>,
}

/// Bind groups of a rasterizer: one for whole lists, or one for each slice of them.
pub(super) enum RasterGroups {
    Whole(wgpu::BindGroup),
    Slices(Vec<wgpu::BindGroup>),
}

impl RasterGroups {
    /// Binds the kernels of whole lists and of slices to buffers of these names and the slices of `space`.
    pub(super) fn of(
        gpu: &Gpu,
        [whole, slice]: &[Kernel; 2],
        space: &Workspace,
        names: &[(&'static str, &Buffer)],
    ) -> RasterGroups {
        let slices = space.all("slice");
        if slices.is_empty() {
            return RasterGroups::Whole(whole.bind(gpu, names));
        }
        let bind = |at| slice.bind(gpu, &[&[("slice", at)], names].concat());
        RasterGroups::Slices(slices.iter().map(bind).collect())
    }
}

impl Bound {
    /// Binds the buffers of `workspace` and `model` to every kernel, once for each slot. With a
    /// workspace that does not train, the backward is left out.
    pub fn new(gpu: &Gpu, kernels: &Kernels, workspace: &Workspace, model: &Model) -> Bound {
        Bound {
            slots: (0..2)
                .map(|slot| Groups::new(gpu, kernels, workspace, model, slot))
                .collect(),
        }
    }
}

impl Groups {
    fn new(gpu: &Gpu, kernels: &Kernels, space: &Workspace, model: &Model, slot: usize) -> Groups {
        let names = space.names(model, slot);
        let with = |extra: &[(&'static str, &'_ Buffer)], kernel: &Kernel| {
            let mut all: Vec<(&str, &Buffer)> = extra.to_vec();
            all.extend(names.iter().copied());
            kernel.bind(gpu, &all)
        };
        // The most counts that the scan may have say which way it takes.
        let scan = |uniform: &Buffer, counts: &Buffer, most: usize| {
            let bind = |kernel| with(&[("scan", uniform), ("counts", counts)], kernel);
            if most <= (SCAN_FEW * WORKGROUP * SCAN_CHUNK) as usize {
                return ScanGroups::Few(bind(&kernels.scan_few));
            }
            let many = [&kernels.scan_reduce, &kernels.scan_spread];
            ScanGroups::Many(many.map(bind))
        };
        let digit_counts = [
            space.buffer("digit_counts"),
            space.buffer("digit_counts_swap"),
        ];
        let radix_shape = kernels.rasterizer.radix();
        let radix = |passes: &[Buffer],
                     entries: [&Buffer; 2],
                     (uniform, most): (&Buffer, usize),
                     [first_counted, moves_counted]: [bool; 2]| {
            let pass = |(i, pass): (usize, &Buffer)| {
                // One pass reads what the other clears and counts, if entries are counted as they move.
                let turn = if moves_counted { i % 2 } else { 0 };
                let from_to = [
                    ("radix", pass),
                    ("entries_in", entries[i % 2]),
                    ("entries_out", entries[1 - i % 2]),
                    ("digit_counts", digit_counts[turn]),
                    ("next_counts", digit_counts[1 - turn]),
                ];
                let n_digits = radix_shape.counts(most);
                let is_counted = if i == 0 { first_counted } else { moves_counted };
                RadixGroups {
                    count: (!is_counted).then(|| with(&from_to, &kernels.radix_count)),
                    scan: match &kernels.radix_scan {
                        Some(kernel) => DigitScan::Digits(kernel.clone(), with(&from_to, kernel)),
                        None => DigitScan::Counts(scan(uniform, digit_counts[0], n_digits)),
                    },
                    shift: with(&from_to, &kernels.radix_move),
                }
            };
            passes.iter().enumerate().map(pass).collect()
        };
        let raster = |kernels: &[Kernel; 2]| RasterGroups::of(gpu, kernels, space, &names);
        let by_degree = |kernels: &[Kernel; 4]| {
            let used = &kernels[..=model.sh_degree as usize];
            used.iter().map(|k| with(&[], k)).collect()
        };
        let uniform = |name| space.of_slot(name, slot);
        let depths = [
            space.buffer("depth_order"),
            space.buffer("depth_order_swap"),
        ];
        let bin = |mode| with(&[("mode", space.of_slot("mode", mode))], &kernels.bin);
        let bin_emit = match kernels.rasterizer {
            Rasterizer::Thread => vec![bin(1), bin(2)],
            Rasterizer::Workgroup => vec![bin(1)],
        };
        let is_workgroup = kernels.rasterizer == Rasterizer::Workgroup;
        Groups {
            project: by_degree(&kernels.project),
            depth_passes: radix(
                space.depth_passes(slot),
                depths,
                (uniform("scan_splat_digits"), model.n),
                [false, radix_shape.counts_moved],
            ),
            pair_passes: radix(
                space.all("pair_passes"),
                space.pair_halves(),
                (uniform("scan_pair_digits"), space.capacity.pairs),
                // Workgroups that emit pairs count the digits of the first pass, too.
                [is_workgroup, false],
            ),
            bin_count: bin(0),
            bin_emit,
            scan_pairs: scan(uniform("scan_pairs"), space.buffer("splat_pairs"), model.n),
            find_tile_ranges: with(&[], &kernels.find_tile_ranges),
            order_tiles: with(&[], &kernels.order_tiles),
            rasterize: raster(&kernels.rasterize),
            backward: space.trains.then(|| BackwardGroups {
                ssim: kernels
                    .ssim
                    .each_ref()
                    .map(|list| list.iter().map(|k| with(&[], k)).collect()),
                loss_sum: [&kernels.loss_blocks, &kernels.loss_total].map(|k| with(&[], k)),
                rasterize: raster(&kernels.rasterize_backward),
                sum_pairs: with(&[], &kernels.sum_pairs),
                sum_gaussians: with(&[], &kernels.sum_gaussians),
                project: by_degree(&kernels.project_backward),
            }),
        }
    }
}
