//! The file of weights: `lpips.LPIPS(net=...).state_dict()` as safetensors, in f32.

use std::path::Path;

use safetensors::{Dtype, SafeTensors};

use super::layers::Conv;
use super::net::ConvSpec;
use super::{InputRange, Lpips, Net, Slice, WEIGHTS_RECIPE};
use crate::error::{Error, Result};
use crate::files::digest::sha256;
use crate::files::read_file;

/// Largest file that is read: VGG's is 59 MB.
const MAX_BYTES: u64 = 1 << 30;

/// The input's shift and scale, the same in every version of LPIPS.
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];

impl Lpips {
    /// Reads the weights of a net, which is told by the tensors' names. Tensors that LPIPS has no
    /// use for are passed over.
    ///
    /// # Errors
    /// A file that cannot be read or is no safetensors file; a tensor that is missing, of another
    /// shape or type, or not finite. All but the first two name the tensor.
    pub fn read(path: &Path, range: InputRange) -> Result<Lpips> {
        let bytes = read_bounded(path)?;
        Self::from_bytes(&bytes, range).map_err(|e| e.at_path(path))
    }

    fn from_bytes(bytes: &[u8], range: InputRange) -> Result<Lpips> {
        // Offsets are held against the bytes that are there; nothing is allocated by the header.
        let file = SafeTensors::deserialize(bytes).map_err(|e| {
            Error::new(format!("not a whole safetensors file: {e}"))
                .way_out(format!("make it again: {WEIGHTS_RECIPE}"))
        })?;
        let net = net_of(&file)?;
        for (name, known) in [("shift", SHIFT), ("scale", SCALE)] {
            let name = format!("scaling_layer.{name}");
            let stored = tensor(&file, &name, &[1, 3, 1, 1])?;
            if stored.iter().zip(known).any(|(a, b)| (a - b).abs() > 1e-6) {
                return Err(
                    Error::new(format!("is {stored:?}, in LPIPS it is {known:?}"))
                        .at(format!("tensor `{name}`"))
                        .way_out(format!("make the file again: {WEIGHTS_RECIPE}")),
                );
            }
        }
        let slices = net.slices().iter().enumerate().map(|(i, spec)| {
            let convs = spec.convs.iter().map(|conv| read_conv(&file, i + 1, conv));
            let convs: Vec<Conv> = convs.collect::<Result<_>>()?;
            let n = convs.last().map_or(0, |conv| conv.n_out);
            Ok(Slice {
                pool: spec.pool,
                convs,
                lin: tensor(&file, &lin_name(i), &[1, n, 1, 1])?,
            })
        });
        Ok(Lpips {
            net,
            range,
            sha256: sha256(bytes),
            shift: SHIFT,
            scale: SCALE,
            slices: slices.collect::<Result<_>>()?,
        })
    }
}

/// Reads a regular file of bounded size: a device has no end.
fn read_bounded(path: &Path) -> Result<Vec<u8>> {
    let is_bounded = |meta: std::fs::Metadata| meta.is_file() && meta.len() <= MAX_BYTES;
    if std::fs::metadata(path).is_ok_and(|meta| !is_bounded(meta)) {
        return Err(Error::new(format!(
            "is not a file of at most {MAX_BYTES} bytes, as LPIPS weights are"
        ))
        .at_path(path)
        .way_out(format!("make it with {WEIGHTS_RECIPE}")));
    }
    read_file(path)
}

fn conv_name(slice: usize, conv: &ConvSpec) -> String {
    format!("net.slice{slice}.{}", conv.index)
}

fn lin_name(slice: usize) -> String {
    format!("lin{slice}.model.1.weight")
}

/// Returns the net that more of the file's convolutions belong to, so that one that is missing does
/// not hide which net it is.
fn net_of(file: &SafeTensors) -> Result<Net> {
    let [alex, vgg] = Net::ALL.map(|net| {
        let names = net.slices().iter().enumerate().flat_map(|(i, spec)| {
            let names = spec.convs.iter().map(move |conv| conv_name(i + 1, conv));
            names.map(|name| name + ".weight")
        });
        names.filter(|name| file.tensor(name).is_ok()).count()
    });
    // The first convolution's name is the same in both.
    match alex.max(vgg) {
        0 | 1 => Err(Error::new(format!(
            "holds the convolutions of neither AlexNet nor VGG16 (`net.slice5.10.weight`, \
             `net.slice5.28.weight`) among its {} tensors",
            file.len()
        ))
        .way_out(format!("make it with {WEIGHTS_RECIPE}"))),
        _ if alex > vgg => Ok(Net::Alex),
        _ => Ok(Net::Vgg),
    }
}

fn read_conv(file: &SafeTensors, slice: usize, spec: &ConvSpec) -> Result<Conv> {
    let name = conv_name(slice, spec);
    let &ConvSpec {
        n_in,
        n_out,
        side,
        stride,
        padding,
        ..
    } = spec;
    let stored = tensor(file, &format!("{name}.weight"), &[n_out, n_in, side, side])?;
    Ok(Conv {
        n_in,
        n_out,
        side,
        stride,
        padding,
        weights: reordered(&stored, n_out, n_in, side * side),
        bias: tensor(file, &format!("{name}.bias"), &[n_out])?,
    })
}

/// Reorders `[n_out][n_in][n_taps]` to `[n_taps][n_in][n_out]`.
fn reordered(stored: &[f32], n_out: usize, n_in: usize, n_taps: usize) -> Vec<f32> {
    let mut weights = Vec::with_capacity(stored.len());
    for tap in 0..n_taps {
        for c in 0..n_in {
            weights.extend((0..n_out).map(|o| stored[(o * n_in + c) * n_taps + tap]));
        }
    }
    weights
}

/// Returns the values of a tensor that must be there, in f32, of this shape and finite.
fn tensor(file: &SafeTensors, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
    let fault = |what: String| {
        Error::new(what)
            .at(format!("tensor `{name}`"))
            .way_out(format!("make the file again: {WEIGHTS_RECIPE}"))
    };
    let view = file
        .tensor(name)
        .map_err(|_| fault("is missing".to_owned()))?;
    if view.shape() != shape {
        return Err(fault(format!("is {:?}, not {shape:?}", view.shape())));
    }
    if view.dtype() != Dtype::F32 {
        return Err(fault(format!("holds {}, not F32", view.dtype())));
    }
    let values: Vec<f32> = view
        .data()
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    if let Some(i) = values.iter().position(|value| !value.is_finite()) {
        return Err(fault(format!("value {i} is {}", values[i])));
    }
    Ok(values)
}
