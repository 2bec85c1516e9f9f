//! Seeded cases: every number of a Gaussian, and of a camera unless it says otherwise, is exactly
//! representable in f32, so a single-precision renderer starts from the same input.

use std::collections::BTreeSet;

use super::linalg::{Vec3, apply, cross, dot, normalize, sub, transpose};
use super::model::{TwinCamera, TwinGaussians};
use super::random::{Random, f32_exact, in_ball};
use super::raster::TwinRender;
use super::sh;

/// Gaussians and the cameras that look at them.
pub struct TwinCase {
    /// Gaussians, in the world of the cameras.
    pub gaussians: TwinGaussians,
    /// The cameras, at least one.
    pub cameras: Vec<TwinCamera>,
}

/// Does the same as [`looking_at`] with all digits of f64 in the pose: its rows are of length 1 to
/// these.
fn exactly_looking_at(eye: Vec3, target: Vec3) -> TwinCamera {
    TwinCamera {
        w2c: pose_looking_at(eye, target),
        ..looking_at(eye, target)
    }
}

fn pose_looking_at(eye: Vec3, target: Vec3) -> [[f64; 4]; 4] {
    let (z, _) = normalize(&sub(&target, &eye));
    let (x, _) = normalize(&cross(&z, &[0.0, -1.0, 0.0]));
    let y = cross(&z, &x);
    let row = |axis: Vec3| [axis[0], axis[1], axis[2], -dot(&axis, &eye)];
    [row(x), row(y), row(z), [0.0, 0.0, 0.0, 1.0]]
}

/// Makes a 160x104 camera at `eye` that looks at `target`, world up -y, centred, 60 degrees wide.
pub fn looking_at(eye: Vec3, target: Vec3) -> TwinCamera {
    TwinCamera {
        w2c: pose_looking_at(eye, target).map(|row| row.map(f32_exact)),
        width: 160,
        height: 104,
        fx: 138.5,
        fy: 138.5,
        cx: 80.0,
        cy: 52.0,
        near: f32_exact(0.02),
        background: [0.0; 3],
        dropout: None,
    }
}

/// Makes four cameras on the unit scale: one outside and centred, one inside the cloud with an
/// off-centre principal point, unequal focal lengths and a background, one far to the side that
/// sees the cloud at its edge, and one near the cloud's rim, so that many means lie beyond the
/// Jacobian's bounds.
pub fn cameras() -> Vec<TwinCamera> {
    let outside = looking_at([1.3, -0.7, 1.1], [0.0; 3]);
    let inside = TwinCamera {
        fx: 121.25,
        fy: 96.5,
        cx: 47.75,
        cy: 66.25,
        background: [0.25, 0.5, 0.75],
        ..looking_at([0.21, 0.13, -0.37], [-0.4, -0.2, 0.3])
    };
    let aside = looking_at([-1.5, 0.2, 0.4], [-0.6, -0.9, -0.9]);
    let rim = TwinCamera {
        fx: 260.0,
        fy: 250.0,
        ..looking_at([0.0, -0.1, -0.75], [0.1, 0.0, 0.0])
    };
    vec![outside, inside, aside, rim]
}

/// The numbers of one Gaussian.
struct Draw {
    mean: Vec3,
    scale: Vec3,
    opacity: f64,
    /// `None`: the rotation is random.
    rotation_wxyz: Option<[f64; 4]>,
}

/// Least distance of two depths in one camera, unless a case says otherwise: single precision tells
/// it at depths of some units.
const DEPTH_GAP: f64 = 1e-5;

/// The cameras of a case, and how far apart depths in one of them are at least.
struct Eyes {
    cameras: Vec<TwinCamera>,
    depth_gap: f64,
}

impl Eyes {
    fn of(cameras: Vec<TwinCamera>) -> Eyes {
        Eyes {
            cameras,
            depth_gap: DEPTH_GAP,
        }
    }

    /// Takes a camera so close to what it sees that depths differ by little.
    fn close(camera: TwinCamera) -> Eyes {
        Eyes {
            cameras: vec![camera],
            depth_gap: 1e-9,
        }
    }
}

/// Returns an integer that orders as `x` does.
fn ordered(x: f64) -> i64 {
    let bits = x.to_bits() as i64;
    bits ^ ((bits >> 63) as u64 >> 1) as i64
}

/// Adds Gaussians drawn by `draw`, with random rotation and SH, but only such as leave no
/// decision a Gaussian open in any camera: near plane, depth order, the Jacobian's bounds and the
/// clamp of the colour all have a margin of 1e-4 or more (depths `depth_gap`).
fn build(
    n: usize,
    sh_degree: usize,
    Eyes { cameras, depth_gap }: Eyes,
    random: &mut Random,
    mut draw: impl FnMut(&mut Random) -> Draw,
) -> TwinCase {
    let mut gaussians = TwinGaussians::empty(sh_degree);
    let mut depths = vec![BTreeSet::new(); cameras.len()];
    while gaussians.n() < n {
        let Draw {
            mean,
            scale,
            opacity,
            rotation_wxyz,
        } = draw(random);
        let mean = mean.map(f32_exact);
        let coefficients: [Vec3; 16] = std::array::from_fn(|k| {
            let spread = if k == 0 { 0.8 } else { 0.2 };
            [(); 3].map(|()| f32_exact(spread * random.normal()))
        });
        let settled = cameras.iter().zip(&depths).all(|(camera, depths)| {
            let p = camera.to_camera(&mean);
            let bounds = camera.tangent_bounds();
            let (direction, _) = normalize(&sub(&mean, &camera.center()));
            let color = sh::color(direction, &coefficients, sh_degree);
            (p[2] - camera.near).abs() > 1e-4
                && (0..2).all(|i| bounds[i].iter().all(|b| (p[i] / p[2] - b).abs() > 1e-4))
                && color.iter().all(|c| c.abs() > 1e-4)
                && depths
                    .range(ordered(p[2] - depth_gap)..=ordered(p[2] + depth_gap))
                    .next()
                    .is_none()
        });
        if settled {
            for (camera, depths) in cameras.iter().zip(&mut depths) {
                depths.insert(ordered(camera.to_camera(&mean)[2]));
            }
            gaussians.means.push(mean);
            gaussians.sh.push(coefficients);
            let logit = (opacity / (1.0 - opacity)).ln();
            gaussians.opacity_logit.push(f32_exact(logit));
            gaussians.scale_log.push(scale.map(|s| f32_exact(s.ln())));
            let rotation = rotation_wxyz.unwrap_or_else(|| [(); 4].map(|()| 1.5 * random.normal()));
            gaussians.rotation_wxyz.push(rotation.map(f32_exact));
        }
    }
    TwinCase { gaussians, cameras }
}

/// Makes `n` Gaussians of mixed shape in a ball of radius 0.8, seen by [`cameras`]. Every tenth is
/// nearly opaque, so that the cap of alpha is reached.
pub fn random_scene(n: usize, sh_degree: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    let size = 0.35 * (n as f64).powf(-1.0 / 3.0);
    build(n, sh_degree, Eyes::of(cameras()), &mut random, |random| {
        Draw {
            mean: in_ball(random, 0.8),
            scale: [(); 3].map(|()| size * (0.6 * random.normal()).exp()),
            opacity: match random.uniform(0.0, 1.0) < 0.1 {
                true => 0.9999,
                false => random.uniform(0.05, 0.97),
            },
            rotation_wxyz: None,
        }
    })
}

/// Makes needles: one axis is 1e4 times the other two.
pub fn needles(n: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    build(n, 1, Eyes::of(cameras()), &mut random, |random| {
        let length = random.uniform(0.1, 0.5);
        Draw {
            mean: in_ball(random, 0.6),
            scale: [length, 1e-4 * length, 1e-4 * length],
            opacity: random.uniform(0.3, 0.97),
            rotation_wxyz: None,
        }
    })
}

/// Makes Gaussians of a hundred scene sizes or so: their means lie off most images, far beyond the
/// Jacobian's bounds, and their ellipses cover whole images.
pub fn huge(n: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    build(n, 2, Eyes::of(cameras()), &mut random, |random| Draw {
        mean: in_ball(random, 3.0),
        scale: [(); 3].map(|()| (3.0 * (0.8 * random.normal()).exp()).min(100.0)),
        opacity: random.uniform(0.1, 0.6),
        rotation_wxyz: None,
    })
}

/// Makes `n_layers` planes of `n_per_layer` discs at exactly equal depth in front of a camera at
/// the origin, many over each other: order within a plane is that of the indices, and the stack is
/// deep enough for the transmittance stop. Indices of one plane are not contiguous.
pub fn layers(n_layers: usize, n_per_layer: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    let camera = looking_at([0.0; 3], [0.0, 0.0, 1.0]);
    let cameras = Eyes::of(vec![camera]);
    let mut case = build(n_layers * n_per_layer, 0, cameras, &mut random, |r| Draw {
        mean: [
            r.uniform(-0.5, 0.5),
            r.uniform(-0.3, 0.3),
            r.uniform(1.0, 2.0),
        ],
        scale: [r.uniform(0.1, 0.3), r.uniform(0.1, 0.3), 0.01],
        opacity: r.uniform(0.3, 0.95),
        rotation_wxyz: None,
    });
    for (i, mean) in case.gaussians.means.iter_mut().enumerate() {
        mean[2] = 1.0 + 0.125 * (i % n_layers) as f64;
    }
    case
}

/// Makes one Gaussian that fills the screen of a camera at the origin: its alpha is far above the
/// least that is drawn at the corners of an image, too, whatever the image's size.
pub fn cover() -> TwinCase {
    let camera = looking_at([0.0; 3], [0.0, 0.0, 1.0]);
    build(1, 2, Eyes::of(vec![camera]), &mut Random::new(3), |_| {
        Draw {
            mean: [0.05, -0.03, 2.0],
            scale: [1.2, 1.0, 0.7],
            opacity: 0.7,
            rotation_wxyz: None,
        }
    })
}

/// Makes `n` Gaussians that each reach one pixel of a 4x8 image, front to back in the order of
/// their indices: those that `is_left` chooses in the two columns on the left, the others on the
/// right. Each takes half a per cent of its pixel's light.
pub fn crowd(n: usize, seed: u64, mut is_left: impl FnMut(usize, &mut Random) -> bool) -> TwinCase {
    let mut random = Random::new(seed);
    let camera = TwinCamera {
        fx: 4.0,
        fy: 4.0,
        ..looking_at([0.0; 3], [0.0, 0.0, 1.0]).resized(4, 8)
    };
    let mut gaussians = TwinGaussians::empty(0);
    for i in 0..n {
        // f32 tells these depths apart by a hundred steps and more, up to a million of them.
        let z = f32_exact(1.0 + 8.0 * i as f64 / n as f64);
        let column =
            random.uniform(0.0, 2.0).floor() + if is_left(i, &mut random) { 0.0 } else { 2.0 };
        let row = random.uniform(0.0, 8.0).floor();
        // Off the pixel's centre, far from the next one's reach.
        let mut at = |pixel: f64| pixel + 0.5 + random.uniform(-0.1, 0.1);
        let (u, v) = (at(column), at(row));
        let mean = [
            (u - camera.cx) * z / camera.fx,
            (v - camera.cy) * z / camera.fy,
            z,
        ];
        gaussians.means.push(mean.map(f32_exact));
        let mut sh = [[0.0; 3]; 16];
        sh[0] = [(); 3].map(|()| f32_exact(random.uniform(-1.0, 1.0)));
        gaussians.sh.push(sh);
        let opacity = random.uniform(0.0046, 0.0049);
        gaussians
            .opacity_logit
            .push(f32_exact((opacity / (1.0 - opacity)).ln()));
        let sigma = |random: &mut Random| random.uniform(0.2, 0.3) * z / camera.fx;
        gaussians
            .scale_log
            .push([(); 3].map(|()| f32_exact(sigma(&mut random).ln())));
        let rotation = [(); 4].map(|()| f32_exact(1.5 * random.normal()));
        gaussians.rotation_wxyz.push(rotation);
    }
    let cameras = vec![camera];
    TwinCase { gaussians, cameras }
}

/// Makes Gaussians that fill a view of 0.1 degrees from distance 1: their depths differ by 1e-3.
pub fn narrow(n: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    let focal = f32_exact(80.0 / 0.05f64.to_radians().tan());
    let camera = TwinCamera {
        fx: focal,
        fy: focal,
        ..exactly_looking_at([0.7, -0.4, 0.6], [0.0; 3])
    };
    let size = 3e-4 * (n as f64).powf(-1.0 / 3.0);
    build(n, 2, Eyes::close(camera), &mut random, |random| Draw {
        mean: in_ball(random, 7e-4),
        scale: [(); 3].map(|()| size * (0.6 * random.normal()).exp()),
        opacity: random.uniform(0.05, 0.97),
        rotation_wxyz: None,
    })
}

/// Makes a camera within a cloud of the size of 1e-3, both off the origin: what it sees is small
/// differences of coordinates.
pub fn beside(n: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    let eye = [0.34, -0.21, 0.43];
    let camera = TwinCamera {
        near: f32_exact(1e-4),
        ..exactly_looking_at(eye, [-0.2, 0.1, -0.3])
    };
    let size = 1e-3 * (n as f64).powf(-1.0 / 3.0);
    build(n, 2, Eyes::close(camera), &mut random, |random| {
        let offset = in_ball(random, 2e-3);
        Draw {
            mean: std::array::from_fn(|axis| eye[axis] + offset[axis]),
            scale: [(); 3].map(|()| size * (0.6 * random.normal()).exp()),
            opacity: random.uniform(0.05, 0.97),
            rotation_wxyz: None,
        }
    })
}

/// Makes needles of a few pixels' width that cross the image, their means 1e4 to 1e5 pixels off it.
pub fn distant_needles(n: usize, seed: u64) -> TwinCase {
    let mut random = Random::new(seed);
    let camera = looking_at([0.3, -0.2, 0.1], [-0.5, 0.4, 1.1]);
    let (to_world, focal) = (transpose(&camera.rotation()), camera.fx);
    let (bounds, eye) = (camera.tangent_bounds(), camera.center());
    build(n, 1, Eyes::of(vec![camera]), &mut random, |random| {
        let depth = random.uniform(0.03, 0.1);
        let distance = 10f64.powf(random.uniform(4.0, 5.0));
        let (sin, cos) = random.uniform(0.0, std::f64::consts::TAU).sin_cos();
        let tangent = [cos, sin].map(|x| distance * x / focal);
        // Towards a place in the image, through the Jacobian, which is that of its bounds.
        let target = [random.uniform(-70.0, 70.0), random.uniform(-40.0, 40.0)];
        let along = random.uniform(-0.5, 0.5);
        let [x, y] = [0, 1].map(|i| {
            let bounded = tangent[i].clamp(bounds[i][0], bounds[i][1]);
            (target[i] / focal - tangent[i]) * focal / distance + along * bounded
        });
        let ([x, y, z], length) = normalize(&apply(&to_world, &[x, y, along]));
        let scale = |pixels: f64| pixels * depth / focal;
        let width = scale(random.uniform(1.0, 5.0));
        let offset = apply(&to_world, &[depth * tangent[0], depth * tangent[1], depth]);
        Draw {
            mean: std::array::from_fn(|axis| eye[axis] + offset[axis]),
            scale: [scale(0.5 * distance) * length, width, width],
            opacity: random.uniform(0.3, 0.97),
            // The turn that takes the first axis there.
            rotation_wxyz: Some([1.0 + x, 0.0, -z, y]),
        }
    })
}

/// Draws weights in [-1, 1) of a linear loss, `(d_rgb, d_alpha)`, 0 at fragile pixels.
pub fn loss_weights(render: &TwinRender, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = Random::new(seed);
    let (mut d_rgb, mut d_alpha) = (Vec::new(), Vec::new());
    for &fragile in &render.fragile {
        let weights = [(); 4].map(|()| f32_exact(random.uniform(-1.0, 1.0)));
        let weights = if fragile { [0.0; 4] } else { weights };
        d_rgb.extend_from_slice(&weights[..3]);
        d_alpha.push(weights[3]);
    }
    (d_rgb, d_alpha)
}
