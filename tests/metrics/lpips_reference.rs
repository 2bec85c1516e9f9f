//! LPIPS from its definition, in f64: six nested loops a convolution, `[channel][y][x]`.

use std::collections::BTreeMap;

use gspotential::scene::Image;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use safetensors::tensor::{Dtype, TensorView};

/// What a net does, in order.
#[derive(Clone, Copy)]
pub(crate) enum Step {
    /// Name, inputs, outputs, side, stride, padding; followed by ReLU.
    Conv(&'static str, usize, usize, usize, usize, usize),
    /// Side, stride.
    Pool(usize, usize),
    /// Features of this many channels are compared.
    Tap(usize),
}
use Step::{Conv, Pool, Tap};

pub(crate) const ALEX: &[Step] = &[
    Conv("net.slice1.0", 3, 64, 11, 4, 2),
    Tap(64),
    Pool(3, 2),
    Conv("net.slice2.3", 64, 192, 5, 1, 2),
    Tap(192),
    Pool(3, 2),
    Conv("net.slice3.6", 192, 384, 3, 1, 1),
    Tap(384),
    Conv("net.slice4.8", 384, 256, 3, 1, 1),
    Tap(256),
    Conv("net.slice5.10", 256, 256, 3, 1, 1),
    Tap(256),
];

pub(crate) const VGG: &[Step] = &[
    Conv("net.slice1.0", 3, 64, 3, 1, 1),
    Conv("net.slice1.2", 64, 64, 3, 1, 1),
    Tap(64),
    Pool(2, 2),
    Conv("net.slice2.5", 64, 128, 3, 1, 1),
    Conv("net.slice2.7", 128, 128, 3, 1, 1),
    Tap(128),
    Pool(2, 2),
    Conv("net.slice3.10", 128, 256, 3, 1, 1),
    Conv("net.slice3.12", 256, 256, 3, 1, 1),
    Conv("net.slice3.14", 256, 256, 3, 1, 1),
    Tap(256),
    Pool(2, 2),
    Conv("net.slice4.17", 256, 512, 3, 1, 1),
    Conv("net.slice4.19", 512, 512, 3, 1, 1),
    Conv("net.slice4.21", 512, 512, 3, 1, 1),
    Tap(512),
    Pool(2, 2),
    Conv("net.slice5.24", 512, 512, 3, 1, 1),
    Conv("net.slice5.26", 512, 512, 3, 1, 1),
    Conv("net.slice5.28", 512, 512, 3, 1, 1),
    Tap(512),
];

/// A file of weights before it is written.
#[derive(Clone)]
pub(crate) struct Tensors(BTreeMap<String, (Vec<usize>, Vec<f32>)>);

impl Tensors {
    fn add(&mut self, name: String, shape: Vec<usize>, values: Vec<f32>) {
        self.0.insert(name, (shape, values));
    }

    pub(crate) fn values(&self, name: &str) -> &[f32] {
        &self.0[name].1
    }

    pub(crate) fn values_mut(&mut self, name: &str) -> &mut Vec<f32> {
        &mut self.0.get_mut(name).expect("a tensor").1
    }

    pub(crate) fn shape(&self, name: &str) -> &[usize] {
        &self.0[name].0
    }

    pub(crate) fn shape_mut(&mut self, name: &str) -> &mut Vec<usize> {
        &mut self.0.get_mut(name).expect("a tensor").0
    }

    pub(crate) fn only(&self, keep: impl Fn(&str) -> bool) -> Tensors {
        let mut kept = self.clone();
        kept.0.retain(|name, _| keep(name));
        kept
    }

    pub(crate) fn without(&self, name: &str) -> Tensors {
        self.only(|other| other != name)
    }

    /// As the file holds them.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.bytes_with_type("", Dtype::F32)
    }

    /// With zeros of another type in the tensor `other`.
    pub(crate) fn bytes_with_type(&self, other: &str, dtype: Dtype) -> Vec<u8> {
        let stored: Vec<(&str, Dtype, &[usize], Vec<u8>)> = self
            .0
            .iter()
            .map(|(name, (shape, values))| {
                if name == other {
                    let bytes = vec![0; values.len() * dtype.bitsize() / 8];
                    (name.as_str(), dtype, shape.as_slice(), bytes)
                } else {
                    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                    (name.as_str(), Dtype::F32, shape.as_slice(), bytes)
                }
            })
            .collect();
        let views = stored.iter().map(|(name, dtype, shape, bytes)| {
            let view = TensorView::new(*dtype, shape.to_vec(), bytes);
            (*name, view.expect("bytes of the shape's size"))
        });
        safetensors::serialize(views, None).expect("tensors")
    }
}

/// Weights that keep a signal alive through the net, with a tensor that LPIPS has no use for, as
/// the package's own files have some.
pub(crate) fn generated(net: &[Step]) -> Tensors {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut tensors = Tensors(BTreeMap::new());
    let mut draw = |n: usize, sigma: f32| -> Vec<f32> {
        let normal = Normal::new(0.0, sigma).expect("a deviation");
        (0..n).map(|_| normal.sample(&mut rng)).collect()
    };
    let mut n_taps = 0;
    for step in net {
        match *step {
            Conv(name, n_in, n_out, side, ..) => {
                let fan_in = n_in * side * side;
                let weights = draw(n_out * fan_in, (2.0 / fan_in as f32).sqrt());
                tensors.add(
                    format!("{name}.weight"),
                    vec![n_out, n_in, side, side],
                    weights,
                );
                tensors.add(format!("{name}.bias"), vec![n_out], draw(n_out, 0.1));
            }
            Tap(n) => {
                let heads: Vec<f32> = draw(n, 1.0).into_iter().map(f32::abs).collect();
                for prefix in ["lin", "lins."] {
                    let name = format!("{prefix}{n_taps}.model.1.weight");
                    tensors.add(name, vec![1, n, 1, 1], heads.clone());
                }
                n_taps += 1;
            }
            Pool(..) => {}
        }
    }
    for (name, values) in [
        ("shift", [-0.030, -0.088, -0.188]),
        ("scale", [0.458, 0.448, 0.450]),
    ] {
        let name = format!("scaling_layer.{name}");
        tensors.add(name, vec![1, 3, 1, 1], values.to_vec());
    }
    tensors
}

/// `[channel][y][x]`.
struct Maps {
    channels: usize,
    height: usize,
    width: usize,
    values: Vec<f64>,
}

impl Maps {
    /// Zero beyond the border.
    fn at(&self, c: usize, y: i64, x: i64) -> f64 {
        if y < 0 || x < 0 || y >= self.height as i64 || x >= self.width as i64 {
            return 0.0;
        }
        self.values[(c * self.height + y as usize) * self.width + x as usize]
    }

    fn filled(
        channels: usize,
        height: usize,
        width: usize,
        value: impl Fn(usize, usize, usize) -> f64,
    ) -> Maps {
        let mut values = Vec::new();
        for c in 0..channels {
            for y in 0..height {
                values.extend((0..width).map(|x| value(c, y, x)));
            }
        }
        Maps {
            channels,
            height,
            width,
            values,
        }
    }
}

/// LPIPS of two images; `signed`: the input is scaled to `[-1, 1]`.
pub(crate) fn reference(
    net: &[Step],
    tensors: &Tensors,
    signed: bool,
    a: &Image,
    b: &Image,
) -> f64 {
    let (a, b) = (
        features(net, tensors, signed, a),
        features(net, tensors, signed, b),
    );
    let mut total = 0.0;
    for (tap, (a, b)) in a.iter().zip(&b).enumerate() {
        let heads = tensors.values(&format!("lin{tap}.model.1.weight"));
        for y in 0..a.height as i64 {
            for x in 0..a.width as i64 {
                let norm = |maps: &Maps| {
                    let squares = (0..maps.channels).map(|c| maps.at(c, y, x).powi(2));
                    squares.sum::<f64>().sqrt() + 1e-10
                };
                let (na, nb) = (norm(a), norm(b));
                for (c, &head) in heads.iter().enumerate() {
                    let difference = a.at(c, y, x) / na - b.at(c, y, x) / nb;
                    total +=
                        f64::from(head) * difference * difference / (a.height * a.width) as f64;
                }
            }
        }
    }
    total
}

fn features(net: &[Step], tensors: &Tensors, signed: bool, image: &Image) -> Vec<Maps> {
    let (shift, scale) = ([-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]);
    let (height, width) = (image.height as usize, image.width as usize);
    let mut maps = Maps::filled(3, height, width, |c, y, x| {
        let value = f64::from(image.rgb[(y * width + x) * 3 + c]) / 255.0;
        let value = if signed { 2.0 * value - 1.0 } else { value };
        (value - shift[c]) / scale[c]
    });
    let mut taps = Vec::new();
    for step in net {
        match *step {
            Conv(name, n_in, n_out, side, stride, padding) => {
                let weights = tensors.values(&format!("{name}.weight"));
                let bias = tensors.values(&format!("{name}.bias"));
                let out = |length: usize| (length + 2 * padding - side) / stride + 1;
                maps = Maps::filled(n_out, out(maps.height), out(maps.width), |o, y, x| {
                    let mut sum = f64::from(bias[o]);
                    for c in 0..n_in {
                        for ky in 0..side {
                            for kx in 0..side {
                                let w = weights[((o * n_in + c) * side + ky) * side + kx];
                                let y = (y * stride + ky) as i64 - padding as i64;
                                let x = (x * stride + kx) as i64 - padding as i64;
                                sum += f64::from(w) * maps.at(c, y, x);
                            }
                        }
                    }
                    sum.max(0.0)
                });
            }
            Pool(side, stride) => {
                let out = |length: usize| (length - side) / stride + 1;
                maps = Maps::filled(
                    maps.channels,
                    out(maps.height),
                    out(maps.width),
                    |c, y, x| {
                        let window = (0..side * side).map(|i| {
                            let (y, x) = (y * stride + i / side, x * stride + i % side);
                            maps.at(c, y as i64, x as i64)
                        });
                        window.fold(f64::NEG_INFINITY, f64::max)
                    },
                );
            }
            Tap(_) => taps.push(Maps {
                values: maps.values.clone(),
                ..maps
            }),
        }
    }
    taps
}
