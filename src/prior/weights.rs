//! This module reads the file of weights: `model.safetensors` as the hub has it.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use safetensors::Dtype;
use safetensors::tensor::{Metadata, TensorInfo};

use super::DOWNLOAD;
use crate::error::{Error, Result};

/// Largest header that is read: that of the largest model has 0.2 MB.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// An opened file of weights, read tensor by tensor so that no second copy of it is in memory.
pub(super) struct Weights {
    path: PathBuf,
    file: File,
    metadata: Metadata,
    /// The byte at which the tensors begin.
    data: u64,
    /// Whether names and shapes are checked only; tensors come back empty then.
    dry: bool,
}

impl Weights {
    /// Opens a file and reads its header, which must announce exactly the bytes that follow.
    ///
    /// # Errors
    /// No regular file, no safetensors file, a file that is cut short or of another model, all with
    /// what to give instead.
    pub(crate) fn open(path: &Path) -> Result<Weights> {
        open(path).map_err(|e| e.at_path(path))
    }

    /// Sets whether tensors are only checked from now on.
    pub(crate) fn set_dry(&mut self, dry: bool) {
        self.dry = dry;
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the count of numbers in all tensors.
    pub(crate) fn n_parameters(&self) -> u64 {
        let sizes = self.metadata.tensors().into_values();
        let counts = sizes.map(|info| info.shape.iter().map(|n| *n as u64).product::<u64>());
        counts.sum()
    }

    pub(crate) fn names(&self) -> impl Iterator<Item = String> {
        self.metadata.offset_keys().into_iter()
    }

    /// Returns the shape of a tensor, `None` if it is not there.
    pub(crate) fn shape(&self, name: &str) -> Option<&[usize]> {
        self.info(name).map(|info| info.shape.as_slice())
    }

    fn info(&self, name: &str) -> Option<&TensorInfo> {
        self.metadata.info(&full_name(name))
    }

    /// Reads the values of a tensor that must be there, in this shape, finite.
    ///
    /// # Errors
    /// Any other tensor, by its name; a file that cannot be read.
    pub(crate) fn tensor(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let read = self.read(name, shape);
        read.map_err(|e| {
            e.at(format!("tensor `{}`", full_name(name)))
                .at_path(&self.path)
        })
    }

    fn read(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let info = self.info(name).ok_or_else(|| fault("is missing"))?;
        if info.shape != shape {
            return Err(fault(format!("is {:?}, not {shape:?}", info.shape)));
        }
        let (dtype, (begin, end)) = (info.dtype, info.data_offsets);
        let size = match dtype {
            Dtype::F32 => 4,
            Dtype::F16 | Dtype::BF16 => 2,
            other => return Err(fault(format!("holds {other}, not F32, F16 or BF16"))),
        };
        let n: usize = shape.iter().product();
        if end.checked_sub(begin) != Some(n * size) {
            return Err(fault("has another number of bytes than its shape"));
        }
        if self.dry {
            return Ok(Vec::new());
        }
        let mut bytes = vec![0; n * size];
        self.file
            .seek(SeekFrom::Start(self.data + begin as u64))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(|e| Error::new(format!("cannot be read: {e}")))?;
        let values: Vec<f32> = match dtype {
            Dtype::F16 => widened(&bytes, half),
            Dtype::BF16 => widened(&bytes, |bits| f32::from_bits(u32::from(bits) << 16)),
            _ => bytes
                .as_chunks()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b))
                .collect(),
        };
        match values.iter().position(|value| !value.is_finite()) {
            Some(i) => Err(fault(format!("value {i} is {}", values[i]))),
            None => Ok(values),
        }
    }
}

/// Names in the file are those of the outer class.
fn full_name(name: &str) -> String {
    format!("model.{name}")
}

fn fault(what: impl Into<String>) -> Error {
    Error::new(what).way_out(format!(
        "the file is damaged or of another model: {DOWNLOAD}"
    ))
}

fn widened(bytes: &[u8], widen: impl Fn(u16) -> f32) -> Vec<f32> {
    let pairs = bytes.as_chunks().0;
    pairs
        .iter()
        .map(|b| widen(u16::from_le_bytes(*b)))
        .collect()
}

/// Converts a number of IEEE 754's binary16.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from(bits >> 10 & 31);
    let fraction = f32::from(bits & 1023) / 1024.0;
    sign * match exponent {
        0 => fraction * 2_f32.powi(-14),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction) * 2_f32.powi(exponent - 15),
    }
}

fn open(path: &Path) -> Result<Weights> {
    if let Some(what) = in_several_files(path) {
        return Err(
            Error::new(what).way_out(format!("only weights in one file are read: {DOWNLOAD}"))
        );
    }
    let meta = std::fs::metadata(path)
        .map_err(|e| Error::new(format!("cannot read the weights: {e}")).way_out(DOWNLOAD))?;
    if !meta.is_file() {
        return Err(Error::new("is not a file").way_out("name the file model.safetensors itself"));
    }
    let cannot = |e: std::io::Error| Error::new(format!("cannot read: {e}"));
    let mut file = File::open(path).map_err(cannot)?;
    let mut head = Vec::new();
    (&mut file).take(8).read_to_end(&mut head).map_err(cannot)?;
    let Some(length) = head.first_chunk().map(|b| u64::from_le_bytes(*b)) else {
        return Err(not_weights(&head, "it has fewer than 8 bytes"));
    };
    if length > MAX_HEADER_BYTES || length + 8 > meta.len() {
        return Err(not_weights(
            &head,
            &format!(
                "its first 8 bytes announce a header of {length} bytes in a file of {}",
                meta.len()
            ),
        ));
    }
    (&mut file)
        .take(length)
        .read_to_end(&mut head)
        .map_err(cannot)?;
    // Offsets are held against shapes here, and against the file's length below.
    let metadata: Metadata =
        serde_json::from_slice(&head[8..]).map_err(|e| not_weights(&head, &e.to_string()))?;
    let (announced, there) = (metadata.data_len() as u64, meta.len() - 8 - length);
    if announced != there {
        return Err(Error::new(format!(
            "the tensors take {announced} bytes, but {there} follow the header"
        ))
        .way_out(format!(
            "the download was cut short or is damaged: {DOWNLOAD}"
        )));
    }
    Ok(Weights {
        path: path.to_owned(),
        file,
        metadata,
        data: 8 + length,
        dry: false,
    })
}

/// Returns what a name says of weights in several files, as large models' are stored: their index,
/// or `model-00001-of-00002.safetensors`.
fn in_several_files(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_string_lossy();
    if name.ends_with(".safetensors.index.json") {
        return Some("is the index of weights in several files");
    }
    let (rest, n) = name.strip_suffix(".safetensors")?.rsplit_once("-of-")?;
    let (_, i) = rest.rsplit_once('-')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    let is_one = n.parse() == Ok(1);
    (is_number(i) && is_number(n) && !is_one).then_some("is one of several files of weights")
}

/// Returns the error for a file that holds no weights, which names what else it may be.
fn not_weights(head: &[u8], why: &str) -> Error {
    let what = if head.starts_with(b"version ") {
        "is a Git LFS pointer, not the weights it stands for"
    } else if head.starts_with(b"PK") {
        "is a PyTorch checkpoint, not a safetensors file"
    } else if head.starts_with(b"<") {
        "is a web page, not a safetensors file"
    } else {
        return Error::new(format!("is not a safetensors file: {why}")).way_out(DOWNLOAD);
    };
    Error::new(what).way_out(DOWNLOAD)
}
