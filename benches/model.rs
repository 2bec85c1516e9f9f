//! What an iteration would take on GPUs that are not at hand: a model, not a measurement.
//!
//! `cargo bench --bench model -- [--scene DIR|builtin:WIDTH] [--max-size PX] [--max-points N]
//! [--set KEY=VALUE]...`
//!
//! The lists of the tiles are real: the training views are rendered here, with the rasterizer that GPUs
//! take, and the entries that tiles go through are counted. Dispatches are those of the program. From
//! them each stage has bytes, arithmetic and a longest chain of dependent loads, and takes the longest of
//! the three on a GPU, with what its dispatches cost beside it. Caches hold what neighbours share and no
//! more; no stage overlaps another; a full GPU gives [`SHARE`] of its arithmetic and of its bandwidth. 2^x is the
//! GPU's own. Waves of 32 lanes skip splats that reach none of their rows.
//!
//! The longest dispatch of all is told, too: a system's watchdog ends those of some seconds.

mod kit;

use clap::Parser;
use gspotential::doctor::{Context, Rig};
use gspotential::error::Result;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::{Commands, Gpu, Rasterizer, shader};
use gspotential::pipeline::prepare;
use gspotential::render::{Splat, ViewUniform, read_totals};
use gspotential::report::{Column, Table};
use gspotential::run::Seconds;
use gspotential::scene::LoadOptions;

use kit::SceneArgs;

#[derive(Parser)]
struct Args {
    #[command(flatten)]
    on: SceneArgs,
    #[arg(long, default_value_t = 1600)]
    max_size: u32,
    #[arg(long, default_value_t = 300_000)]
    max_points: usize,
}

/// Peaks by their makers' data sheets, and what a dispatch and a dependent load are taken to cost.
struct Machine {
    name: &'static str,
    bytes_a_second: f64,
    /// Instructions of one lane; a multiplication with an addition is one.
    lane_ops_a_second: f64,
    /// Lanes a wave; a tile has 256 pixels on 64.
    lanes: u32,
    dispatch_s: f64,
    load_s: f64,
}

const MACHINES: [Machine; 4] = [
    Machine {
        name: "UHD 770",
        bytes_a_second: 76.8e9,
        lane_ops_a_second: 0.41e12,
        lanes: 32,
        dispatch_s: 10e-6,
        load_s: 0.30e-6,
    },
    Machine {
        name: "RX 6800",
        bytes_a_second: 512e9,
        lane_ops_a_second: 8.1e12,
        lanes: 64,
        dispatch_s: 4e-6,
        load_s: 0.35e-6,
    },
    Machine {
        name: "RTX 4090",
        bytes_a_second: 1008e9,
        lane_ops_a_second: 41.3e12,
        lanes: 32,
        dispatch_s: 3e-6,
        load_s: 0.30e-6,
    },
    Machine {
        name: "H200",
        bytes_a_second: 4800e9,
        lane_ops_a_second: 33.5e12,
        lanes: 32,
        dispatch_s: 3e-6,
        load_s: 0.35e-6,
    },
];

/// Share of a peak that a stage reaches.
const SHARE: f64 = 0.6;

/// Instructions a pixel and an entry of its tile's list, of the compiled loops; the backward's tree is in it. Waves of
/// 32 skip what the tile's other wave adds up, wider ones do not: the first number is theirs, the second the others'. What
/// [`SKIPPED_SHARE`] of them are left where a wave skips the entry.
const FORWARD_OPS: f64 = 18.0;
const BACKWARD_OPS: [f64; 2] = [54.0, 64.0];
const SKIPPED_SHARE: f64 = 0.15;
/// The backward's leaves are written and summed up for skipped entries, too.
const SKIPPED_SHARE_BACKWARD: f64 = 0.5;
/// Instructions a pixel and channel of the compiled loss, without a mask: those of a turn, four pixels a lane, and the pixels that
/// strips and their parts have in common with their neighbours.
const LOSS_OPS: f64 = 880.0;

/// What a view holds.
#[derive(Clone, Copy, Default)]
struct View {
    gaussians: f64,
    pairs: f64,
    tiles: f64,
    pixels: f64,
    /// Entries of the tiles' lists, times their pixels: the most that are gone through forward.
    listed: f64,
    /// Entries up to the last that a pixel of the tile has blended, times its pixels: those that are
    /// gone through backward.
    blended: f64,
    /// The part of both in halves of tiles, eight rows, that the entry's splat does not reach.
    listed_beyond: f64,
    blended_beyond: f64,
    /// The part of the blended at pixels where the splat is drawn, and in blocks of 8x8 pixels of which it is drawn in one.
    drawn: f64,
    drawn_blocks: f64,
    /// The longest list.
    longest: f64,
}

/// A stage's work.
struct Stage {
    name: &'static str,
    dispatches: f64,
    bytes: f64,
    ops: f64,
    /// Dependent loads in a row.
    chain: f64,
}

impl Stage {
    fn seconds(&self, on: &Machine) -> f64 {
        self.dispatches * on.dispatch_s + self.work_s(on)
    }

    fn work_s(&self, on: &Machine) -> f64 {
        let bytes = self.bytes / (SHARE * on.bytes_a_second);
        let ops = self.ops / (SHARE * on.lane_ops_a_second);
        bytes.max(ops).max(self.chain * on.load_s)
    }
}

/// The stages of a view of SH degree 3, forward and backward, on waves of so many lanes.
fn stages(view: &View, passes: [f64; 2], lanes: u32) -> Vec<Stage> {
    let View {
        gaussians: n,
        pairs: p,
        tiles,
        pixels,
        listed,
        blended,
        listed_beyond,
        blended_beyond,
        longest,
        ..
    } = *view;
    let [skipped, backward_ops] = match lanes {
        ..=32 => [1.0, BACKWARD_OPS[0]],
        _ => [0.0, BACKWARD_OPS[1]],
    };
    let listed = listed - skipped * (1.0 - SKIPPED_SHARE) * listed_beyond;
    let blended = blended - skipped * (1.0 - SKIPPED_SHARE_BACKWARD) * blended_beyond;
    let radix = Rasterizer::Workgroup.radix();
    // Entries are read twice and written once; a count is written, read and written again, and read. An entry that is counted as
    // it moves is read once, and adds to a count, which is read and written: as many bytes.
    let counts = f64::from(radix.digits()) / f64::from(radix.chunk);
    let pass = |entries: f64| entries * (3.0 * 8.0 + 4.0 * 4.0 * counts);
    let of = |name, dispatches, bytes, ops, chain| Stage {
        name,
        dispatches,
        bytes,
        ops,
        chain,
    };
    vec![
        of("project", 1.0, n * (240.0 + 56.0), n * 500.0, 2.0),
        of(
            "depth sort",
            // Digits of the first pass are counted by themselves.
            1.0 + 2.0 * passes[0],
            passes[0] * pass(n),
            passes[0] * n * 60.0,
            passes[0] * 40.0,
        ),
        of(
            "bin and scan",
            4.0,
            2.0 * n * 56.0 + p * 12.0,
            n * 200.0 + p * 40.0,
            100.0,
        ),
        // Emission has counted the digits of the first pass.
        of(
            "tile sort",
            3.0 * passes[1] - 1.0,
            passes[1] * pass(p) - p * 8.0,
            passes[1] * p * 60.0,
            passes[1] * 40.0,
        ),
        of(
            "tile ranges and order",
            2.0,
            p * 20.0 + tiles * 24.0,
            p * 10.0,
            20.0,
        ),
        of(
            "rasterize",
            1.0,
            p * 56.0 + pixels * 20.0,
            listed * FORWARD_OPS,
            longest / 64.0 * 3.0,
        ),
        // The sums are taken every tenth iteration.
        // 22 turns, each a load and four barriers.
        of("loss", 1.2, pixels * 32.0, 3.0 * pixels * LOSS_OPS, 50.0),
        of(
            "rasterize backward",
            1.0,
            p * 92.0 + pixels * 36.0,
            blended * backward_ops,
            longest / 32.0 * 8.0,
        ),
        of("sum pairs", 2.0, p * 40.0 + n * 96.0, p * 12.0, 156.0),
        of(
            "project backward",
            1.0,
            n * (240.0 + 48.0 + 80.0),
            n * 1500.0,
            2.0,
        ),
    ]
}

/// Adam: parameters and both moments read and written, and the gradients.
fn adam(n: f64) -> Stage {
    Stage {
        name: "Adam",
        dispatches: 4.0,
        bytes: n * (6.0 * 240.0 + 48.0 + 32.0 + 3.0 * 48.0),
        ops: n * 1000.0,
        chain: 8.0,
    }
}

fn main() -> Result<()> {
    let args = Args::parse();
    let mut config = args.on.config("paper")?;
    config.scene.max_size_px = Some(args.max_size);
    config.scene.max_points = Some(args.max_points);
    config.views.count = 0;
    let options = LoadOptions {
        n_test: 1,
        ..LoadOptions::new(&config)
    };
    let scene = args.on.load(args.max_size, options)?;
    let prepared = prepare(&scene, &config, &mut Seconds::default())?;
    let ctx = Context::from_sources(Gpu::open()?, Rasterizer::Workgroup, &shader::compose);
    let thread = Context::from_sources(Gpu::open()?, Rasterizer::Thread, &shader::compose);
    let views = &prepared.supervision.real;
    let mut mean = View::default();
    let mut tile_bits = 1;
    let mut thread_pairs = 0.0;
    let share = 1.0 / views.len() as f64;
    for view in views {
        let uniform = ViewUniform::new(&view.camera, prepared.supervision.near, [0.0; 3]);
        let mut rig = Rig::new(&ctx, &prepared.start, uniform, config.model.sh_degree)?;
        rig.forward(&ctx)?;
        let one = look(&ctx, &rig)?;
        drop(rig);
        thread_pairs += share * count_pairs(&thread, &prepared.start, uniform)?;
        mean.gaussians += share * one.gaussians;
        mean.pairs += share * one.pairs;
        mean.tiles += share * one.tiles;
        mean.pixels += share * one.pixels;
        mean.listed += share * one.listed;
        mean.blended += share * one.blended;
        mean.listed_beyond += share * one.listed_beyond;
        mean.blended_beyond += share * one.blended_beyond;
        mean.drawn += share * one.drawn;
        mean.drawn_blocks += share * one.drawn_blocks;
        mean.longest = mean.longest.max(one.longest);
        tile_bits = (one.tiles as usize)
            .next_power_of_two()
            .ilog2()
            .max(tile_bits);
    }
    let radix = Rasterizer::Workgroup.radix();
    let passes = [32, tile_bits].map(|bits| f64::from(radix.passes(bits)));
    println!(
        "{}, means of {} views: {:.0} Gaussians, {:.0} pairs of 16x16 tiles and {thread_pairs:.0} of 4x8, {:.0} tiles, \
         {:.0} pixels, \
         {:.1} entries a pixel listed, {:.1} up to the last that its tile blends, {:.0} in the longest list; \
         of them {:.0} % and {:.0} % in halves of tiles that the splat does not reach; {:.1} are drawn, {:.1} where blocks of 8x8 \
         pixels have lists of their own\n\n{}\n{}",
        scene.name,
        views.len(),
        mean.gaussians,
        mean.pairs,
        mean.tiles,
        mean.pixels,
        mean.listed / mean.pixels,
        mean.blended / mean.pixels,
        mean.longest,
        100.0 * mean.listed_beyond / mean.listed,
        100.0 * mean.blended_beyond / mean.blended,
        mean.drawn / mean.pixels,
        mean.drawn_blocks / mean.pixels,
        table(&mean, passes),
        longest_dispatches(&mean, passes)
    );
    Ok(())
}

/// Counts what a rendered view has gone through.
fn look(ctx: &Context, rig: &Rig) -> Result<View> {
    let size = rig.view.size;
    let n_slots = ctx.kernels.rasterizer.n_slots(size);
    let n_tiles = ctx.kernels.rasterizer.n_tiles(size);
    let lists: Vec<[u32; 4]> = rig.read(ctx, "tile_order", n_slots)?;
    let plane = 4 * rig.view.plane_len();
    let planes: Vec<u32> = rig.read(ctx, "d_rendered", 5 * plane)?;
    let last_blended = &planes[4 * plane..];
    let entries: Vec<[u32; 2]> = rig.read(ctx, "tile_splats", read_pairs(ctx, rig)?)?;
    let splats: Vec<Splat> = rig.read(ctx, "splats", rig.model.n)?;
    let [columns, _] = ctx.kernels.rasterizer.tiles(size).map(|n| n as usize);
    let side = ctx.kernels.rasterizer.tile()[0] as usize;
    let row = 4 * rig.view.padded_size().0;
    let mut view = View {
        gaussians: rig.model.n as f64,
        pairs: entries.len() as f64,
        tiles: n_tiles as f64,
        pixels: rig.view.n_pixels() as f64,
        ..View::default()
    };
    for [tile, first, end, _] in lists {
        let tile = tile as usize;
        if tile >= n_tiles {
            continue;
        }
        let (left, top) = (tile % columns * side, tile / columns * side);
        let mut deepest = 0;
        for y in top..(top + side).min(size[1] as usize) {
            let pixels = left..(left + side).min(size[0] as usize);
            let blended = pixels.map(|x| last_blended[y * row + x]);
            deepest = deepest.max(blended.max().unwrap_or(0).min(end - first));
        }
        let n_pixels = (side * side) as f64;
        view.listed += f64::from(end - first) * n_pixels;
        view.blended += f64::from(deepest) * n_pixels;
        for (place, [gaussian, _]) in (first..end).zip(&entries[first as usize..end as usize]) {
            let splat = &splats[*gaussian as usize];
            let n = [top, top + side / 2]
                .map(|row| f64::from(is_beyond(splat, row, side / 2)))
                .iter()
                .sum::<f64>();
            view.listed_beyond += 0.5 * n * n_pixels;
            if place - first < deepest {
                view.blended_beyond += 0.5 * n * n_pixels;
                let is_left = |x: usize, y: usize| place - first < last_blended[y * row + x];
                let (drawn, blocks) = count_drawn(splat, [left, top], side, size, is_left);
                view.drawn += drawn;
                view.drawn_blocks += blocks;
            }
        }
        view.longest = view.longest.max(f64::from(end - first));
    }
    Ok(view)
}

/// Returns the (tile, Gaussian) pairs of a view with the context's rasterizer, for which there need not be room.
fn count_pairs(ctx: &Context, gaussians: &Gaussians, view: ViewUniform) -> Result<f64> {
    let rig = Rig::new(ctx, gaussians, view, gaussians.sh_degree)?;
    rig.start(ctx);
    let mut commands = Commands::new(&ctx.gpu);
    let pass = rig.pass(ctx);
    pass.project(&mut commands);
    pass.sort_by_depth(&mut commands);
    pass.count_pairs(&mut commands);
    pass.scan_pairs(&mut commands);
    commands.submit();
    Ok(read_totals(&ctx.gpu, &rig.workspace)?.pairs as f64)
}

/// Returns the (tile, Gaussian) pairs of the view that was rendered.
fn read_pairs(ctx: &Context, rig: &Rig) -> Result<usize> {
    Ok(read_totals(&ctx.gpu, &rig.workspace)?.pairs)
}

/// Whether a splat reaches none of `n` rows of pixels, as the kernels see it.
fn is_beyond(splat: &Splat, row: usize, n: usize) -> bool {
    (row..row + n).all(|y| {
        let t_y = splat.t_0[1] + splat.l_yy * (y as f32 + 0.5 - splat.anchor[1]);
        t_y * t_y > splat.reach * 1.0001 + 1e-4
    })
}

/// Side of the blocks of pixels that are looked at within a tile.
const BLOCK: usize = 8;

/// Counts the pixels of a tile at which a splat is drawn, of those that still take splats, and those of the blocks in which
/// one is.
fn count_drawn(
    splat: &Splat,
    [left, top]: [usize; 2],
    side: usize,
    size: [u32; 2],
    is_left: impl Fn(usize, usize) -> bool,
) -> (f64, f64) {
    let mut drawn = 0;
    let mut blocks = vec![0; (side / BLOCK) * (side / BLOCK)];
    for y in top..(top + side).min(size[1] as usize) {
        let dy = y as f32 + 0.5 - splat.anchor[1];
        let t_y = splat.t_0[1] + splat.l_yy * dy;
        for x in left..(left + side).min(size[0] as usize) {
            let t_x =
                splat.t_0[0] + splat.l_xx * (x as f32 + 0.5 - splat.anchor[0]) + splat.l_xy * dy;
            if t_x * t_x + t_y * t_y <= splat.reach && is_left(x, y) {
                drawn += 1;
                blocks[(y - top) / BLOCK * (side / BLOCK) + (x - left) / BLOCK] = BLOCK * BLOCK;
            }
        }
    }
    (f64::from(drawn), blocks.iter().sum::<usize>() as f64)
}

/// Says which dispatch is the longest on each machine.
fn longest_dispatches(view: &View, passes: [f64; 2]) -> String {
    let one = |on: &Machine| {
        let stages = stages(view, passes, on.lanes).into_iter();
        // The dispatches of a stage share its work; but for sorts and sums, one has nearly all.
        let work = stages.map(|stage| (stage.work_s(on), stage.name));
        let (seconds, name) = work.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        format!(
            "{}: no dispatch is longer than {:.1} ms ({name})\n",
            on.name,
            1e3 * seconds
        )
    };
    MACHINES.iter().map(one).collect()
}

/// The stages of an iteration of two views on each machine.
fn table(view: &View, passes: [f64; 2]) -> Table {
    let mut columns = vec![
        Column::text("stage", "an iteration of two views"),
        Column::number("dispatches", "dispatches", 0),
        Column::number("mb", "MB", 1),
    ];
    for machine in &MACHINES {
        columns.push(Column::number(machine.name, machine.name, 2));
    }
    let mut table = Table::new("model", &columns);
    let mut all = [0.0; MACHINES.len() + 2];
    let on_each = MACHINES.each_ref().map(|on| {
        let mut stages = stages(view, passes, on.lanes);
        stages.push(adam(view.gaussians));
        stages
    });
    for (i, stage) in on_each[0].iter().enumerate() {
        let times = if i + 1 < on_each[0].len() { 2.0 } else { 1.0 };
        let mut numbers = vec![times * stage.dispatches, times * stage.bytes / 1e6];
        let seconds = MACHINES
            .iter()
            .zip(&on_each)
            .map(|(on, own)| own[i].seconds(on));
        numbers.extend(seconds.map(|seconds| 1e3 * times * seconds));
        for (sum, number) in all.iter_mut().zip(&numbers) {
            *sum += number;
        }
        let mut cells = vec![stage.name.into()];
        cells.extend(numbers.into_iter().map(Into::into));
        table.row(cells);
    }
    let mut cells = vec!["**all**".into()];
    cells.extend(all.map(Into::into));
    table.row(cells);
    table
}
