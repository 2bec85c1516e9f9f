//! Surface meshes: the depth that they are made of, and how near they come to the true surface.

use glam::{DVec3, Vec3, dvec3};
use gspotential::camera::Camera;
use gspotential::gaussians::Gaussians;
use gspotential::gpu::Gpu;
use gspotential::mesh::{DepthImage, Grid, Mesh, Volume, depth};
use gspotential::render::{Kernels, Model, NO_MEDIAN, Renderer, ViewUniform};
use gspotential::scene::builtin::{CENTER, surface_distance, test_cameras, trace};
use rstar::RTree;

use crate::geometry::camera;

/// Flat Gaussians on one plane that is tilted to the camera, a faint veil before it, and nothing
/// beside it.
#[test]
fn median_depth_lies_on_a_tilted_plane_behind_a_veil() {
    let view = camera(dvec3(0.0, 0.0, -3.0), DVec3::ZERO);
    let tilt = glam::Quat::from_rotation_y(0.9);
    let mut gaussians = Gaussians::default();
    let mut add = |mean: Vec3, sigma: f32, opacity: f32| {
        gaussians.means.push(mean);
        gaussians
            .scales_log
            .push(Vec3::new(sigma, sigma, 1e-3).map(f32::ln));
        gaussians
            .rotations_wxyz
            .push([tilt.w, tilt.x, tilt.y, tilt.z]);
        gaussians
            .opacity_logits
            .push((opacity / (1.0 - opacity)).ln());
        gaussians.sh.extend([0.5, 0.5, 0.5]);
    };
    for i in -4..=4 {
        for j in -4..=4 {
            let at = 0.2 * Vec3::new(i as f32, j as f32, 0.0);
            add(tilt * at, 0.15, 0.9);
        }
    }
    add(Vec3::new(0.0, 0.0, -1.0), 0.3, 0.2);
    let gpu = Gpu::open().unwrap();
    let kernels = Kernels::new(&gpu);
    let model = Model::upload(&gpu, &gaussians, gaussians.len()).unwrap();
    let uniform = ViewUniform::new(&view, 0.01, [0.0; 3]);
    let mut renderer = Renderer::new(&gpu, &kernels);
    let (image, medians) = renderer.render_medians(&model, &uniform).unwrap();
    let depths = depth(&view, &gaussians, &medians);
    let normal = (tilt * Vec3::Z).as_dvec3();
    let mut n_seen = 0;
    for (pixel, found) in depths.iter().enumerate() {
        let (x, y) = (pixel % 64, pixel / 64);
        // More than half of the light is taken, or there is no median.
        let alpha = image.alpha[pixel];
        if (alpha - 0.5).abs() > 0.01 {
            assert_eq!(medians[pixel] != NO_MEDIAN, alpha > 0.5, "{x} {y}: {alpha}");
        }
        if medians[pixel] == NO_MEDIAN {
            assert_eq!(*found, 0.0);
            continue;
        }
        let ray = dvec3(
            (x as f64 + 0.5 - view.cx) / view.fx,
            (y as f64 + 0.5 - view.cy) / view.fy,
            1.0,
        );
        let ray = view.rotation.transpose() * ray;
        let exact = -view.center().dot(normal) / ray.dot(normal);
        assert!(
            (f64::from(*found) - exact).abs() < 2e-3,
            "{x} {y}: {found} {exact}"
        );
        n_seen += 1;
    }
    assert!(n_seen > 300 && n_seen < 64 * 48, "{n_seen}");
}

/// The mesh that exact depth of the built-in scene gives.
fn exact_mesh(cameras: &[Camera], voxels: u32) -> (Mesh, Grid) {
    let traced: Vec<_> = cameras.iter().map(trace).collect();
    let images: Vec<(Vec<f32>, Vec<f32>)> = traced
        .iter()
        .map(|traced| {
            let depth = traced.depth.iter().map(|z| *z as f32).collect();
            let rgb = traced.image.rgb.iter().map(|v| f32::from(*v) / 255.0);
            (depth, rgb.collect())
        })
        .collect();
    let images: Vec<DepthImage> = images
        .iter()
        .zip(cameras)
        .map(|((depth, rgb), camera)| DepthImage { camera, depth, rgb })
        .collect();
    let mut points: Vec<DVec3> = images.iter().flat_map(|image| image.points(3)).collect();
    points.retain(|p| p.distance(CENTER) < 1.5);
    let grid = Grid::around(&points, voxels).unwrap();
    let mut volume = Volume::new(grid);
    images.iter().for_each(|image| volume.add(image));
    (volume.surface(), grid)
}

#[test]
fn fused_depth_gives_the_true_surface_with_open_holes_and_its_colours() {
    let cameras = test_cameras(160, 24);
    let (mesh, grid) = exact_mesh(&cameras, 96);
    assert!(mesh.triangles.len() > 5_000, "{}", mesh.triangles.len());
    let mut off: Vec<f64> = mesh
        .positions
        .iter()
        .map(|p| surface_distance(*p).abs())
        .collect();
    off.sort_unstable_by(f64::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() * 95 / 100]);
    println!(
        "median {:.2}, 95 % within {:.2} voxels",
        median / grid.voxel,
        most / grid.voxel
    );
    assert!(median < 0.3 * grid.voxel && most < 1.5 * grid.voxel);

    // Triangles face the free space before them.
    let outwards = mesh.triangles.iter().filter(|triangle| {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        surface_distance((a + b + c) / 3.0 + 2.0 * grid.voxel * normal) > 0.0
    });
    let share = outwards.count() as f64 / mesh.triangles.len() as f64;
    assert!(share > 0.95, "{share}");

    // What the cameras see within the grid is there.
    let tree = RTree::bulk_load(mesh.positions.iter().map(|p| p.to_array()).collect());
    let (mut n_near, mut n, mut color_off) = (0, 0, 0.0);
    for camera in &test_cameras(80, 6) {
        let traced = trace(camera);
        let depth: Vec<f32> = traced.depth.iter().map(|z| *z as f32).collect();
        let image = DepthImage {
            camera,
            depth: &depth,
            rgb: &[],
        };
        for p in image.points(2).iter().filter(|p| p.distance(CENTER) < 1.2) {
            n += 1;
            let nearest = tree
                .nearest_neighbor_iter_with_distance_2(p.to_array())
                .next();
            let (vertex, squared) = nearest.unwrap();
            if squared.sqrt() < 1.5 * grid.voxel {
                n_near += 1;
                let i = mesh.positions.iter().position(|p| p.to_array() == *vertex);
                let (pixel, _) = camera.project(*p);
                let at = 3 * (pixel.y as usize * 80 + pixel.x as usize);
                let seen = traced.image.rgb[at..at + 3]
                    .iter()
                    .map(|v| f32::from(*v) / 255.0);
                let differences = seen
                    .zip(mesh.colors[i.unwrap()])
                    .map(|(a, b)| (a - b).abs());
                color_off += differences.sum::<f32>() / 3.0;
            }
        }
    }
    let complete = f64::from(n_near) / f64::from(n);
    println!(
        "complete to {:.1} %, colours off by {:.3}",
        100.0 * complete,
        color_off / n_near as f32
    );
    assert!(
        complete > 0.9 && color_off / (n_near as f32) < 0.1,
        "{complete}"
    );
}

#[test]
fn what_a_single_view_does_not_see_stays_open() {
    let cameras = &test_cameras(120, 8)[..1];
    let (mesh, grid) = exact_mesh(cameras, 64);
    let traced = trace(&cameras[0]);
    assert!(mesh.triangles.len() > 500);
    for p in &mesh.positions {
        let (pixel, z) = cameras[0].project(*p);
        let (x, y) = (pixel.x as usize, pixel.y as usize);
        // Near what one of the pixels around it sees.
        let around = (y.saturating_sub(2)..=y + 2)
            .flat_map(|y| (x.saturating_sub(2)..=x + 2).map(move |x| (x, y)))
            .filter(|(x, y)| *x < 120 && *y < 80)
            .map(|(x, y)| (traced.depth[y * 120 + x] - z).abs());
        let off = around.fold(f64::MAX, f64::min);
        assert!(off < 4.0 * grid.voxel, "{p}: {off}");
    }
}

#[test]
fn grids_without_a_surface_or_beyond_memory_are_refused() {
    for none in [&[][..], &[DVec3::ONE; 9]] {
        let error = Grid::around(none, 64).unwrap_err().to_string();
        assert!(error.contains("no surface"), "{error}");
    }
    let cube = [DVec3::ZERO, DVec3::ONE];
    let error = Grid::around(&cube, 3000).unwrap_err().to_string();
    assert!(
        error.contains("MiB") && error.contains("--mesh-voxels"),
        "{error}"
    );
    let grid = Grid::around(&cube, 100).unwrap();
    assert!(grid.size.iter().all(|n| (100..=102).contains(n)), "{grid}");
    let n_voxels: u64 = grid.size.iter().map(|n| u64::from(*n)).product();
    assert_eq!(grid.bytes() / 20, n_voxels);
}
