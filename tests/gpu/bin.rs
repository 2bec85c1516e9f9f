//! Tile lists, their order and the prefix sums.

use gspotential::gpu::constants::{RIM, TILE_H, TILE_W, TOTAL_PAIRS};

use super::project::decode;
use super::render::print;
use super::rig::{Rig, context, gaussians_of, view_of};
use crate::reference::fixture::fixtures;
use gspotential::reference::bin::{TileGrid, tile_lists};
use gspotential::reference::cases::{huge, layers, needles, random_scene};
use gspotential::reference::model::{TwinCamera, TwinGaussians, TwinSplat};
use gspotential::reference::project::project;
use gspotential::reference::raster::ALPHA_MIN;
use gspotential::reference::tolerance;

/// Whether a tile meets the box around the ellipse on which alpha is 1/255.
fn box_meets(splat: &TwinSplat, grid: &TileGrid, tile: usize) -> bool {
    let q = 2.0 * (splat.opacity / ALPHA_MIN).ln();
    let corner = [
        tile % grid.columns() * grid.tile_width,
        tile / grid.columns() * grid.tile_height,
    ];
    let size = [grid.tile_width, grid.tile_height];
    let variance = [splat.cov2d[0], splat.cov2d[2]];
    (0..2).all(|axis| {
        // A little more than the rim by which lists may reach further.
        let reach = (q * variance[axis]).sqrt() * 1.001 + 10.0 * RIM;
        let first = corner[axis] as f64 + 0.5 - splat.mean2d[axis];
        let last = first + size[axis] as f64 - 1.0;
        first <= reach && last >= -reach
    })
}

fn hold(name: &str, gaussians: &TwinGaussians, camera: &TwinCamera) {
    let twin: Vec<TwinSplat> = (0..gaussians.len())
        .map(|i| project(gaussians, i, camera))
        .collect();
    let grid = TileGrid {
        width: camera.width,
        height: camera.height,
        tile_width: TILE_W as usize,
        tile_height: TILE_H as usize,
    };
    let needed = tile_lists(&twin, &grid, ALPHA_MIN * (1.0 + tolerance::FRAGILE));

    let ctx = context();
    let degree = gaussians.sh_degree as u32;
    let mut rig = Rig::new(&ctx, &gaussians_of(gaussians, 3), view_of(camera), degree);
    rig.forward(&ctx);
    let splats = decode(&ctx, &rig);
    let n = gaussians.len();
    let totals: Vec<u32> = rig.read(&ctx, "totals", 4);
    let n_pairs = totals[TOTAL_PAIRS as usize] as usize;
    let ranges: Vec<[u32; 2]> = rig.read(&ctx, "tile_ranges", grid.n_tiles());
    let order: Vec<[u32; 2]> = rig.read(&ctx, "depth_order", n);
    let firsts: Vec<u32> = rig.read(&ctx, "splat_pairs", n);
    let pairs: Vec<[u32; 2]> = rig.read(&ctx, "tile_pairs", n_pairs);
    let pair_gaussian: Vec<u32> = rig.read(&ctx, "pair_gaussian", n_pairs);
    drop(ctx);

    // Drawn splats by (depth, Gaussian), then the others.
    let mut expected: Vec<usize> = (0..n).collect();
    let depth = |i: usize| splats[i].map_or(f64::INFINITY, |s| s[2]);
    expected.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)).then(a.cmp(&b)));
    let order: Vec<usize> = order.iter().map(|o| o[1] as usize).collect();
    assert_eq!(order, expected, "{name}: depth order");
    let mut rank = vec![0; n];
    for (r, &id) in order.iter().enumerate() {
        rank[id] = r;
    }

    let mut counts = vec![0_u32; n];
    let mut seen = vec![false; n_pairs];
    let mut n_boxes = 0;
    let mut start = 0;
    for (tile, &[from, to]) in ranges.iter().enumerate() {
        if from < to {
            assert_eq!(
                from, start,
                "{name}: tile {tile} begins where the last one ends"
            );
            start = to;
        }
        let list = &pairs[from as usize..to as usize];
        let mut listed = Vec::new();
        let mut previous = None;
        for &[own_tile, pair] in list {
            assert_eq!(own_tile as usize, tile, "{name}");
            let id = pair_gaussian[pair as usize] as usize;
            assert!(
                previous < Some(rank[id]),
                "{name}: tile {tile}: {id} out of order"
            );
            previous = Some(rank[id]);
            let fits = box_meets(&twin[id], &grid, tile);
            assert!(fits, "{name}: tile {tile} is far from splat {id}");
            assert!(!seen[pair as usize], "{name}: pair {pair} twice");
            seen[pair as usize] = true;
            counts[rank[id]] += 1;
            let end = firsts.get(rank[id] + 1).copied();
            let own = firsts[rank[id]] <= pair && pair < end.unwrap_or(n_pairs as u32);
            assert!(own, "{name}: pair {pair} is not one of splat {id}");
            listed.push(id);
        }
        // Both are by depth, but single precision may tell close depths apart otherwise.
        for id in &needed[tile] {
            assert!(listed.contains(id), "{name}: tile {tile} lacks splat {id}");
        }
        n_boxes += (0..n)
            .filter(|&i| splats[i].is_some() && box_meets(&twin[i], &grid, tile))
            .count();
    }
    assert_eq!(start as usize, n_pairs, "{name}: pairs in tiles");
    let mut sum = 0;
    for (r, &count) in counts.iter().enumerate() {
        assert_eq!(firsts[r], sum, "{name}: first pair of rank {r}");
        sum += count;
    }
    assert_eq!(sum as usize, n_pairs, "{name}: pairs");
    let n_needed: usize = needed.iter().map(Vec::len).sum();
    print(&format!(
        "{name}: {n_needed} pairs needed, {n_pairs} listed, {n_boxes} by bounding boxes\n"
    ));
    // The lists are by rows of the ellipse: what they hold too much is its corners.
    assert!(
        n_pairs as f64 <= 1.15 * n_needed as f64 + 50.0,
        "{name}: lists are too long"
    );
}

#[test]
fn tile_lists_hold_what_is_needed_in_order() {
    let random = random_scene(500, 0, 70);
    for (i, camera) in random.cameras.iter().enumerate() {
        hold(&format!("random {i}"), &random.gaussians, camera);
        for (width, height) in [(1, 1), (7, 5), (33, 17)] {
            let camera = camera.resized(width, height);
            let name = format!("random {i} {width}x{height}");
            hold(&name, &random.gaussians, &camera);
        }
    }
    for (name, case) in [
        ("huge", huge(60, 71)),
        ("needles", needles(80, 72)),
        ("layers", layers(4, 100, 73)),
    ] {
        for camera in &case.cameras {
            hold(name, &case.gaussians, camera);
        }
    }
}

#[test]
fn tile_lists_of_a_reference_case_hold_what_is_needed_in_order() {
    for fixture in fixtures() {
        let view = fixture.view(0);
        hold(&fixture.name, &view.gaussians, &view.camera);
    }
}
