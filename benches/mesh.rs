//! How near a mesh of the built-in scene comes to its true surface.
//!
//! `gspotential train --scene builtin --out run`, `gspotential export run --mesh --out mesh.obj`, then
//! `cargo bench --bench mesh -- mesh.obj`: of its vertices, the distance to the surface, and of what
//! test views see within the mesh's box, the distance to the nearest vertex. Lengths are in the
//! scene's unit, about half the arrangement's height.

use std::path::PathBuf;

use clap::Parser;
use glam::DVec3;
use gspotential::error::{Error, Result};
use gspotential::mesh::DepthImage;
use gspotential::report::{Column, Table};
use gspotential::scene::builtin::{surface_distance, test_cameras, trace};
use rstar::RTree;

#[derive(Parser)]
struct Args {
    /// Mesh in the scene's own frame
    mesh: PathBuf,
    /// Test views whose pixels are looked for in it
    #[arg(long, default_value_t = 12)]
    views: usize,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let vertices = vertices(&args.mesh)?;
    let mut table = Table::new(
        "mesh",
        &[
            Column::text("what", "distance"),
            Column::number("n", "of", 0),
            Column::number("mean", "mean", 4),
            Column::number("median", "median", 4),
            Column::number("p90", "90 % within", 4),
            Column::number("share", "% within 0.05", 1),
        ],
    );
    let off = vertices.iter().map(|p| surface_distance(*p).abs());
    row(&mut table, "vertices to the surface", off.collect());
    let bound = |of: fn(DVec3, DVec3) -> DVec3| vertices.iter().copied().reduce(of);
    let (least, most) = (bound(DVec3::min), bound(DVec3::max));
    let (Some(least), Some(most)) = (least, most) else {
        return Err(Error::new("has no vertex").at_path(&args.mesh));
    };
    let tree = RTree::bulk_load(vertices.iter().map(|p| p.to_array()).collect());
    let mut far = Vec::new();
    for camera in &test_cameras(160, args.views) {
        let depth: Vec<f32> = trace(camera).depth.iter().map(|z| *z as f32).collect();
        let image = DepthImage {
            camera,
            depth: &depth,
            rgb: &[],
        };
        let inside = image.points(2).into_iter();
        let inside = inside.filter(|p| p.clamp(least, most) == *p);
        far.extend(inside.filter_map(|p| {
            let mut near = tree.nearest_neighbor_iter_with_distance_2(p.to_array());
            near.next().map(|(_, squared)| squared.sqrt())
        }));
    }
    row(&mut table, "what test views see to a vertex", far);
    println!("{table}");
    Ok(())
}

fn row(table: &mut Table, what: &str, mut distances: Vec<f64>) {
    distances.sort_unstable_by(f64::total_cmp);
    let n = distances.len();
    let at = |share: f64| distances.get((share * n as f64) as usize).copied();
    let mean = distances.iter().sum::<f64>() / n as f64;
    let within = distances.partition_point(|d| *d <= 0.05) as f64 / n as f64;
    table.row([
        what.into(),
        n.into(),
        mean.into(),
        at(0.5).into(),
        at(0.9).into(),
        (100.0 * within).into(),
    ]);
}

/// Reads the places of an OBJ file.
fn vertices(path: &std::path::Path) -> Result<Vec<DVec3>> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Error::new(format!("cannot read: {e}")).at_path(path))?;
    let places = text.lines().filter_map(|line| line.strip_prefix("v "));
    let place = |line: &str| {
        let mut numbers = line.split_whitespace().map(|word| word.parse().ok());
        let mut next = || numbers.next().flatten();
        Some(DVec3::new(next()?, next()?, next()?))
    };
    let places: Option<Vec<DVec3>> = places.map(place).collect();
    places.ok_or_else(|| Error::new("a vertex has no three numbers").at_path(path))
}
