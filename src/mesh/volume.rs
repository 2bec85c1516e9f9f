//! This module averages depth images into a volume of signed distances, and takes the surface from it.

use fast_surface_nets::ndshape::RuntimeShape;
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::DVec3;
use rayon::prelude::*;

use super::Mesh;
use super::pieces::without_small_pieces;
use crate::camera::Camera;
use crate::error::{Error, Result};

/// Distances count up to so many voxels from a surface.
const TRUNCATION: f64 = 4.0;
/// Most bytes of a volume.
const MOST_BYTES: u64 = 8 << 30;
/// Share of the points on either side of an axis that need not lie within the grid.
const OUTLIERS: f64 = 0.005;
/// Voxels around the points.
const MARGIN: f64 = 6.0;

/// Places of voxels: a box of cubes along the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The first voxel's centre.
    pub origin: DVec3,
    /// Length of a voxel's side.
    pub voxel: f64,
    /// Voxels along each axis.
    pub size: [u32; 3],
}

impl Grid {
    /// Lays a grid around points, whose longest side has `longest` voxels. The outermost 0.5 % of the
    /// points on either side of each axis may lie outside.
    ///
    /// # Errors
    /// No point, points at one place, or a grid of more memory than there may be.
    pub fn around(points: &[DVec3], longest: u32) -> Result<Grid> {
        let bounds = |axis: usize| {
            let mut along: Vec<f64> = points.iter().map(|p| p[axis]).collect();
            along.sort_unstable_by(f64::total_cmp);
            let out = (OUTLIERS * along.len() as f64) as usize;
            Some((*along.get(out)?, *along.get(along.len() - 1 - out)?))
        };
        let no_surface = || {
            Error::new("the training views see no surface near the focus")
                .way_out("train the scene longer, or look at its renders")
        };
        let [Some(x), Some(y), Some(z)] = [bounds(0), bounds(1), bounds(2)] else {
            return Err(no_surface());
        };
        let least = DVec3::new(x.0, y.0, z.0);
        let sides = DVec3::new(x.1, y.1, z.1) - least;
        if !(sides.max_element() > 0.0 && sides.is_finite()) {
            return Err(no_surface());
        }
        let inner = (f64::from(longest) - 2.0 * MARGIN).max(1.0);
        let voxel = sides.max_element() / inner;
        let size = sides
            .to_array()
            .map(|side| (side / voxel + 2.0 * MARGIN).ceil() as u32 + 1);
        let grid = Grid {
            origin: least - MARGIN * voxel,
            voxel,
            size,
        };
        if grid.bytes() > MOST_BYTES || grid.n_voxels() >= u64::from(u32::MAX) {
            let fits = (MOST_BYTES as f64 / grid.bytes() as f64).cbrt();
            return Err(Error::new(format!(
                "{} voxels take {} MiB, and at most {} are taken",
                grid,
                grid.bytes() >> 20,
                MOST_BYTES >> 20
            ))
            .way_out(format!(
                "ask for at most {} along the longest side with --mesh-voxels",
                (fits * f64::from(longest)) as u32
            )));
        }
        Ok(grid)
    }

    fn n_voxels(&self) -> u64 {
        self.size.iter().map(|n| u64::from(*n)).product()
    }

    /// Returns the bytes of a volume and of what finds its surface.
    pub fn bytes(&self) -> u64 {
        let a_voxel = size_of::<Voxel>() + size_of::<f32>() + size_of::<u32>();
        self.n_voxels().saturating_mul(a_voxel as u64)
    }

    fn index(&self, [x, y, z]: [u32; 3]) -> usize {
        let [w, h, _] = self.size.map(|n| n as usize);
        (z as usize * h + y as usize) * w + x as usize
    }
}

impl std::fmt::Display for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}x{}", self.size[0], self.size[1], self.size[2])
    }
}

/// What the views say of a cube.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Voxel {
    /// Mean distance to the surface, positive before it, in shares of the truncation.
    distance: f32,
    /// Mean colour of the surface near it, in 65535ths.
    color: [u16; 3],
    /// Views that saw it, up to 255.
    n_seen: u8,
    /// Those that saw the surface near it.
    n_colored: u8,
}

/// A render with its depth.
#[derive(Clone, Copy, Debug)]
pub struct DepthImage<'a> {
    /// Its camera.
    pub camera: &'a Camera,
    /// Depth along the camera's axis, `[height][width]`; 0 where nothing is.
    pub depth: &'a [f32],
    /// Colours, `[height][width][3]`.
    pub rgb: &'a [f32],
}

impl DepthImage<'_> {
    /// Returns the points of the world behind every `step`-th pixel of every `step`-th row.
    pub fn points(&self, step: usize) -> Vec<DVec3> {
        let camera = self.camera;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut points = Vec::new();
        for y in (0..height).step_by(step) {
            for x in (0..width).step_by(step) {
                let depth = f64::from(self.depth[y * width + x]);
                if depth > 0.0 {
                    let ray = DVec3::new(
                        (x as f64 + 0.5 - camera.cx) / camera.fx,
                        (y as f64 + 0.5 - camera.cy) / camera.fy,
                        1.0,
                    );
                    points.push(camera.center() + camera.rotation.transpose() * ray * depth);
                }
            }
        }
        points
    }
}

/// Signed distances on a grid.
pub struct Volume {
    grid: Grid,
    voxels: Vec<Voxel>,
    n_views: u8,
}

impl Volume {
    /// Makes a volume that no view has seen.
    pub fn new(grid: Grid) -> Volume {
        Volume {
            grid,
            voxels: vec![Voxel::default(); grid.n_voxels() as usize],
            n_views: 0,
        }
    }

    /// Adds what a view sees: every voxel from the camera to a little behind the surface.
    pub fn add(&mut self, image: &DepthImage<'_>) {
        self.n_views = self.n_views.saturating_add(1);
        let grid = self.grid;
        let [width, height, _] = grid.size.map(|n| n as usize);
        self.voxels
            .par_chunks_exact_mut(width * height)
            .enumerate()
            .for_each(|(z, slab)| {
                for (y, row) in slab.chunks_exact_mut(width).enumerate() {
                    for (x, voxel) in row.iter_mut().enumerate() {
                        let place = DVec3::new(x as f64, y as f64, z as f64);
                        voxel.see(image, grid.origin + grid.voxel * place, grid.voxel);
                    }
                }
            });
    }

    /// Takes the surface: a vertex in every cell of eight voxels that all were seen and do not lie
    /// on one side. What only one of several views saw does not count, nor do small loose pieces.
    ///
    /// Surface nets (Gibson 1998) have one vertex a cell and squarer triangles than marching cubes.
    pub fn surface(&self) -> Mesh {
        let least = self.n_views.min(2);
        let is_seen = |voxel: &Voxel| voxel.n_seen >= least && voxel.n_seen > 0;
        let outside = |voxel: &Voxel| if is_seen(voxel) { voxel.distance } else { 1.0 };
        let distances: Vec<f32> = self.voxels.par_iter().map(outside).collect();
        let mut net = SurfaceNetsBuffer::default();
        let shape = RuntimeShape::<u32, 3>::new(self.grid.size);
        let last = self.grid.size.map(|n| n - 1);
        surface_nets(&distances, &shape, [0; 3], last, &mut net);
        let cells: Vec<[&Voxel; 8]> = net
            .surface_points
            .iter()
            .map(|cell| self.corners(*cell))
            .collect();
        let is_whole: Vec<bool> = cells
            .iter()
            .map(|corners| corners.iter().all(|voxel| is_seen(voxel)))
            .collect();
        let place = |p: &[f32; 3]| {
            let [x, y, z] = p.map(f64::from);
            self.grid.origin + self.grid.voxel * DVec3::new(x, y, z)
        };
        let (triangles, _) = net.indices.as_chunks::<3>();
        let mesh = Mesh {
            positions: net.positions.iter().map(place).collect(),
            colors: cells.iter().map(color).collect(),
            triangles: triangles.to_vec(),
        };
        let whole = mesh.kept(|i| mesh.triangles[i].iter().all(|v| is_whole[*v as usize]));
        without_small_pieces(&whole)
    }

    fn corners(&self, [x, y, z]: [u32; 3]) -> [&Voxel; 8] {
        std::array::from_fn(|i| {
            let step = [0, 1, 2].map(|axis| (i as u32 >> axis) & 1);
            &self.voxels[self.grid.index([x + step[0], y + step[1], z + step[2]])]
        })
    }
}

/// Returns the mean colour of a cell's voxels, of those near the surface above all.
fn color(corners: &[&Voxel; 8]) -> [f32; 3] {
    let weight = |voxel: &Voxel| match voxel.n_colored {
        0 => 0.0,
        _ => 1.01 - voxel.distance.abs(),
    };
    let total: f32 = corners.iter().map(|voxel| weight(voxel)).sum();
    [0, 1, 2].map(|channel| {
        let own = corners
            .iter()
            .map(|voxel| weight(voxel) * f32::from(voxel.color[channel]));
        own.sum::<f32>() / (65535.0 * total.max(f32::MIN_POSITIVE))
    })
}

impl Voxel {
    /// Takes in what an image says of the voxel at `place`.
    fn see(&mut self, image: &DepthImage<'_>, place: DVec3, side: f64) {
        let camera = image.camera;
        let (pixel, z) = camera.project(place);
        // NaN is outside, too.
        let within = |at: f64, size: u32| at >= 0.0 && at < f64::from(size);
        if z <= 0.0 || !(within(pixel.x, camera.width) && within(pixel.y, camera.height)) {
            return;
        }
        let at = pixel.y as usize * camera.width as usize + pixel.x as usize;
        let depth = f64::from(image.depth[at]);
        let before = (depth - z) / (TRUNCATION * side);
        if depth <= 0.0 || before < -1.0 {
            return;
        }
        self.n_seen = self.n_seen.saturating_add(1);
        self.distance += (before.min(1.0) as f32 - self.distance) / f32::from(self.n_seen);
        if before > 1.0 {
            return;
        }
        self.n_colored = self.n_colored.saturating_add(1);
        for (mean, value) in self.color.iter_mut().zip(&image.rgb[3 * at..]) {
            let value = 65535.0 * value.clamp(0.0, 1.0);
            let old = f32::from(*mean);
            *mean = (old + (value - old) / f32::from(self.n_colored)).round() as u16;
        }
    }
}
