//! The stages of the forward pass up to the sorted tile lists, each on what the one before left.

use std::collections::HashSet;

use super::finding::Findings;
use super::rig::{Context, Rig};
use super::stage;
use crate::doctor::twin::bin::{TileGrid, tile_lists};
use crate::doctor::twin::model::{TwinCamera, TwinSplat};
use crate::doctor::twin::raster::ALPHA_MIN;
use crate::doctor::twin::tolerance;
use crate::error::Result;
use crate::gpu::Commands;
use crate::gpu::constants::{BLOCK_H, BLOCK_W, RIM, TOTAL_PAIRS};
use crate::render::{Pass, Splat};

/// A projected Gaussian as the GPU stores it: `u, v, A, B, C, r, g, b, opacity`.
type Row = [f64; 9];

const COLUMNS: [&str; 9] = ["u", "v", "A", "B", "C", "r", "g", "b", "opacity"];

/// Total lengths of the tile lists of a view.
#[derive(Clone, Copy, Debug)]
pub struct ListLengths {
    /// Pairs that some pixel needs.
    pub needed: usize,
    /// Pairs that the GPU has listed.
    pub listed: usize,
    /// Pairs that the splats' bounding boxes would make.
    pub boxes: usize,
}

/// Runs the stages up to the tile ranges one by one on a poisoned workspace and holds each against
/// the reference's splats. The pairs must fit.
///
/// # Errors
/// A GPU fault.
pub fn examine(
    ctx: &Context,
    rig: &Rig,
    camera: &TwinCamera,
    twin: &[TwinSplat],
    projection_bound: f64,
    out: &mut Findings,
) -> Result<ListLengths> {
    let run = |record: fn(&Pass<'_>, &mut Commands<'_>)| {
        let mut commands = Commands::new(&ctx.gpu);
        record(&rig.pass(ctx), &mut commands);
        commands.submit();
    };
    let own = stage::own(ctx.kernels.rasterizer);
    rig.start(ctx);
    run(|pass, commands| pass.project(commands));
    let splats = read_splats(ctx, rig)?;
    hold_splats(&splats, twin, projection_bound, out);

    let n = rig.model.n;
    let keys: Vec<[u32; 2]> = rig.read(ctx, "depth_order", n)?;
    hold_keys(&keys, &splats, twin, camera, out);
    run(|pass, commands| pass.sort_by_depth(commands));
    let order: Vec<[u32; 2]> = rig.read(ctx, "depth_order", n)?;
    out.equal((own.radix_sort, "by depth"), &order, &sorted(&keys));

    run(|pass, commands| pass.count_pairs(commands));
    let counts: Vec<u32> = rig.read(ctx, "splat_pairs", n)?;
    run(|pass, commands| pass.scan_pairs(commands));
    let firsts: Vec<u32> = rig.read(ctx, "splat_pairs", n)?;
    let totals: Vec<u32> = rig.read(ctx, "totals", 4)?;
    let total = totals[TOTAL_PAIRS as usize];
    let mut sums = exclusive_sums(&counts);
    out.equal((own.scan, "total"), &[total], &[sums.pop().unwrap_or(0)]);
    out.equal((own.scan, "first pairs"), &firsts, &sums);

    run(|pass, commands| pass.emit_pairs(commands));
    // A count that is wrong may be any number.
    let n_pairs = (total as usize).min(rig.workspace.capacity.pairs);
    let pairs: Vec<[u32; 2]> = rig.read(ctx, "pairs", n_pairs)?;
    let rasterizer = ctx.kernels.rasterizer;
    let [tile_width, tile_height] = rasterizer.tile().map(|side| side as usize);
    let grid = TileGrid {
        width: camera.width,
        height: camera.height,
        tile_width,
        tile_height,
    };
    let emitted = Emitted {
        pairs: &pairs,
        pair_gaussian: rig.read(ctx, "pair_gaussian", n_pairs)?,
        gaussian_pairs: rig.read(ctx, "gaussian_pairs", n)?,
    };
    let lengths = hold_pairs(own.bin, &emitted, &order, &counts, twin, &grid, out);

    run(|pass, commands| pass.sort_by_tile(commands));
    let tile_pairs: Vec<[u32; 2]> = rig.read(ctx, "tile_pairs", n_pairs)?;
    let expected = sorted(&pairs);
    out.equal((own.radix_sort, "by tile"), &tile_pairs, &expected);
    run(|pass, commands| pass.find_tile_ranges(commands));
    // Empties those of tiles without pairs, too.
    run(|pass, commands| pass.order_tiles(commands));
    let ranges: Vec<[u32; 2]> = rig.read(ctx, "tile_ranges", grid.n_tiles())?;
    let expected = ranges_of(&expected, grid.n_tiles());
    out.equal((stage::TILE_RANGES, "ranges"), &ranges, &expected);
    let found: Vec<[u32; 2]> = rig.read(ctx, "tile_splats", n_pairs)?;
    let gaussian_of = |pair: u32| emitted.pair_gaussian.get(pair as usize).copied();
    let with_gaussian = |[_, pair]: &[u32; 2]| [gaussian_of(*pair).unwrap_or(u32::MAX), *pair];
    let splats: Vec<[u32; 2]> = tile_pairs.iter().map(with_gaussian).collect();
    out.equal((stage::TILE_RANGES, "Gaussians"), &found, &splats);
    let order: Vec<[u32; 4]> = rig.read(ctx, "tile_order", rasterizer.n_slots(rig.view.size))?;
    let expected = order_of(&expected, &grid);
    out.equal((stage::TILE_ORDER, "tiles"), &order, &expected);
    Ok(lengths)
}

/// Reads the splats back; `None` for a Gaussian that is not drawn. The conic is stored as its
/// Cholesky factor L scaled by `sqrt(log2(e) / 2)`, the mean as L (anchor - mean).
fn read_splats(ctx: &Context, rig: &Rig) -> Result<Vec<Option<Row>>> {
    let splats: Vec<Splat> = rig.read(ctx, "splats", rig.model.n)?;
    let two_ln_2 = 2.0 * std::f64::consts::LN_2;
    let row = |splat: Splat| {
        let [x, y] = splat.anchor.map(f64::from);
        let [t_x, t_y] = splat.t_0.map(f64::from);
        let [l_xx, l_xy, l_yy] = [splat.l_xx, splat.l_xy, splat.l_yy].map(f64::from);
        let [r, g, b] = splat.color.map(f64::from);
        let opacity = f64::from(splat.opacity);
        let from_mean = t_y / l_yy;
        (splat.reach > 0.0).then_some([
            x - (t_x - l_xy * from_mean) / l_xx,
            y - from_mean,
            two_ln_2 * l_xx * l_xx,
            two_ln_2 * l_xx * l_xy,
            two_ln_2 * (l_xy * l_xy + l_yy * l_yy),
            r,
            g,
            b,
            opacity,
        ])
    };
    Ok(splats.into_iter().map(row).collect())
}

fn hold_splats(splats: &[Option<Row>], twin: &[TwinSplat], bound: f64, out: &mut Findings) {
    let is_visible = |s: &TwinSplat| s.valid && s.opacity > ALPHA_MIN;
    let visible: Vec<bool> = twin.iter().map(is_visible).collect();
    let drawn: Vec<bool> = splats.iter().map(Option::is_some).collect();
    out.equal((stage::PROJECT, "which are drawn"), &drawn, &visible);
    let (mut ours, mut theirs): (Vec<Row>, Vec<Row>) = (Vec::new(), Vec::new());
    for (row, s) in splats.iter().zip(twin) {
        if let (Some(row), true) = (row, is_visible(s)) {
            let ([u, v], [a, b, c], [red, green, blue]) = (s.mean2d, s.conic, s.rgb);
            ours.push(*row);
            theirs.push([u, v, a, b, c, red, green, blue, s.opacity]);
        }
    }
    for (c, column) in COLUMNS.into_iter().enumerate() {
        let pick = |rows: &[Row]| rows.iter().map(|r| r[c]).collect::<Vec<_>>();
        out.close(
            (stage::PROJECT, column),
            &pick(&ours),
            &pick(&theirs),
            bound,
        );
    }
}

/// Holds keys to the reference's depths: keys order as these do; those of splats that are not drawn
/// come last. Depths may share a key only where f32 holds neither them nor their distances from the
/// frame's origin apart.
fn hold_keys(
    keys: &[[u32; 2]],
    splats: &[Option<Row>],
    twin: &[TwinSplat],
    camera: &TwinCamera,
    out: &mut Findings,
) {
    let mut order: Vec<usize> = (0..keys.len()).filter(|&i| splats[i].is_some()).collect();
    order.sort_by(|&a, &b| twin[a].depth.total_cmp(&twin[b].depth));
    let disordered = order.windows(2).filter(|pair| {
        let [a, b] = [pair[0], pair[1]].map(|i| (keys[i][0], twin[i].depth));
        let size = b.1.min((b.1 - camera.w2c[2][3]).abs());
        let apart = b.1 - a.1 > f64::from(f32::EPSILON) * size;
        a.0 > b.0 || (apart && a.0 == b.0) || (a.1 == b.1 && a.0 != b.0)
    });
    let n_last = (0..keys.len()).filter(|&i| (keys[i][0] == u32::MAX) == splats[i].is_some());
    out.none(
        (stage::PROJECT, "order of keys"),
        disordered.count() + n_last.count(),
    );
    let ids: Vec<u32> = keys.iter().map(|k| k[1]).collect();
    let expected: Vec<u32> = (0..keys.len() as u32).collect();
    out.equal((stage::PROJECT, "Gaussians of keys"), &ids, &expected);
}

/// Sorts by key and leaves equal keys as they were.
pub(super) fn sorted(entries: &[[u32; 2]]) -> Vec<[u32; 2]> {
    let mut sorted = entries.to_vec();
    sorted.sort_by_key(|entry| entry[0]);
    sorted
}

/// Returns the sums of all counts before each, and of all.
fn exclusive_sums(counts: &[u32]) -> Vec<u32> {
    let mut sum = 0;
    let mut sums = vec![0];
    sums.extend(counts.iter().map(|count| {
        sum = count.wrapping_add(sum);
        sum
    }));
    sums
}

/// Returns the first and one past the last entry of each tile.
fn ranges_of(tile_pairs: &[[u32; 2]], n_tiles: usize) -> Vec<[u32; 2]> {
    let mut ranges = vec![[0; 2]; n_tiles];
    for (i, [tile, _]) in tile_pairs.iter().enumerate() {
        if let Some(range) = ranges.get_mut(*tile as usize) {
            if range[1] == 0 {
                range[0] = i as u32;
            }
            range[1] = i as u32 + 1;
        }
    }
    ranges
}

/// Returns the tiles block by block, a block's tiles by length, longest first, equal ones in rows,
/// each with its range; the number of tiles stands for those outside the image.
fn order_of(ranges: &[[u32; 2]], grid: &TileGrid) -> Vec<[u32; 4]> {
    let (columns, rows) = (grid.columns(), ranges.len() / grid.columns());
    let [block_w, block_h] = [BLOCK_W, BLOCK_H].map(|side| side as usize);
    let mut order = Vec::new();
    for top in (0..rows).step_by(block_h) {
        for left in (0..columns).step_by(block_w) {
            let in_block = |i: usize| (left + i % block_w, top + i / block_w);
            let tiles = (0..block_w * block_h).map(in_block);
            let tiles = tiles.filter(|(x, y)| *x < columns && *y < rows);
            let mut block: Vec<usize> = tiles.map(|(x, y)| y * columns + x).collect();
            block.sort_by_key(|tile| std::cmp::Reverse(ranges[*tile][1] - ranges[*tile][0]));
            block.resize(block_w * block_h, ranges.len());
            order.extend(block.into_iter().map(|tile| {
                let [first, end] = ranges.get(tile).copied().unwrap_or_default();
                [tile as u32, first, end, 0]
            }));
        }
    }
    order
}

/// The pairs before they are sorted by tile.
struct Emitted<'a> {
    /// (tile, pair).
    pairs: &'a [[u32; 2]],
    pair_gaussian: Vec<u32>,
    gaussian_pairs: Vec<[u32; 2]>,
}

/// Holds the pairs to the reference: they are numbered splat by splat in depth order, as many as
/// were counted, each splat's tiles ascending; every tile that a pixel needs is there, and none off
/// the splat's bounding box.
fn hold_pairs(
    bin: &'static str,
    emitted: &Emitted<'_>,
    order: &[[u32; 2]],
    counts: &[u32],
    twin: &[TwinSplat],
    grid: &TileGrid,
    out: &mut Findings,
) -> ListLengths {
    let (mut n_misplaced, mut n_lacking, mut n_far) = (0, 0, 0);
    // A tile list is by depth, but single precision may tell close depths apart otherwise: only
    // what a tile holds is compared.
    let mut needed = vec![Vec::new(); twin.len()];
    let lists = tile_lists(twin, grid, ALPHA_MIN * (1.0 + tolerance::FRAGILE));
    for (tile, list) in lists.iter().enumerate() {
        list.iter().for_each(|&id| needed[id].push(tile));
    }
    let mut lengths = ListLengths {
        needed: needed.iter().map(Vec::len).sum(),
        listed: emitted.pairs.len(),
        boxes: 0,
    };
    let mut first = 0_u32;
    for (&[_, id], &count) in order.iter().zip(counts) {
        let end = first.wrapping_add(count);
        let id = id as usize;
        let Some(splat) = twin.get(id) else {
            n_misplaced += 1;
            continue;
        };
        let end_at = (end as usize).min(emitted.pairs.len());
        let range = (first as usize).min(end_at)..end_at;
        let own = &emitted.pairs[range.clone()];
        n_misplaced += usize::from(emitted.gaussian_pairs[id] != [first, end]);
        n_misplaced += (count as usize).abs_diff(own.len());
        n_misplaced += own.iter().zip(first..).filter(|(p, i)| p[1] != *i).count();
        n_misplaced += own.windows(2).filter(|p| p[0][0] >= p[1][0]).count();
        let of_others = emitted.pair_gaussian[range].iter();
        n_misplaced += of_others.filter(|other| **other as usize != id).count();
        let tiles: HashSet<usize> = own.iter().map(|p| p[0] as usize).collect();
        n_lacking += needed[id].iter().filter(|t| !tiles.contains(t)).count();
        n_far += tiles
            .iter()
            .filter(|t| !box_meets(splat, grid, **t))
            .count();
        if !own.is_empty() {
            lengths.boxes += box_tiles(splat, grid);
        }
        first = end;
    }
    out.none((bin, "pairs misplaced"), n_misplaced);
    out.none((bin, "tiles lacking"), n_lacking);
    out.none((bin, "tiles out of reach"), n_far);
    lengths
}

/// Returns the first and last tile, across and down, that meet the box around the ellipse on which
/// alpha is 1/255, a little more than the rim by which lists may reach further.
fn box_of(splat: &TwinSplat, grid: &TileGrid) -> [[i64; 2]; 2] {
    let q = 2.0 * (splat.opacity / ALPHA_MIN).ln().max(0.0);
    let size = [grid.tile_width, grid.tile_height];
    let image = [grid.width, grid.height];
    let variance = [splat.cov2d[0], splat.cov2d[2]];
    std::array::from_fn(|axis| {
        let reach = (q * variance[axis]).sqrt() * 1.001 + 10.0 * RIM;
        let first = (splat.mean2d[axis] - reach - 0.5).ceil().max(0.0);
        let last = (splat.mean2d[axis] + reach - 0.5).floor();
        let last = last.min(image[axis] as f64 - 1.0);
        [first, last].map(|pixel| (pixel / size[axis] as f64).floor() as i64)
    })
}

fn box_meets(splat: &TwinSplat, grid: &TileGrid, tile: usize) -> bool {
    if tile >= grid.n_tiles() {
        return false;
    }
    let at = [tile % grid.columns(), tile / grid.columns()];
    let bounds = box_of(splat, grid);
    (0..2).all(|axis| (bounds[axis][0]..=bounds[axis][1]).contains(&(at[axis] as i64)))
}

fn box_tiles(splat: &TwinSplat, grid: &TileGrid) -> usize {
    let sides = box_of(splat, grid).map(|[first, last]| (last - first + 1).max(0) as usize);
    sides[0] * sides[1]
}
