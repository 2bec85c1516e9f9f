//! Files of weights: those released, tensor by tensor, and files that are none.

use std::fs;
use std::path::Path;

use gspotential::prior::{Images, Network, Outputs, check};
use image::{Rgb, RgbImage};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors, serialize};
use serde_json::{Map, Value, json};

use super::golden;
use crate::kit::program::run;

/// Names and shapes of a released file.
fn tensors(list: &str) -> Vec<(String, Vec<usize>)> {
    let text = fs::read_to_string(golden(list)).expect("is there");
    let parse = |line: &str| {
        let (name, shape) = line.split_once(' ').expect("a name and a shape");
        let sides = shape
            .trim()
            .split('x')
            .map(|n| n.parse().expect("a number"));
        (name.to_owned(), sides.collect())
    };
    text.lines().map(parse).collect()
}

/// A file that announces such tensors and has as many bytes, all of them 0 and none on the disk.
fn write(path: &Path, tensors: &[(String, Vec<usize>)]) {
    let (mut header, mut end) = (Map::new(), 0);
    for (name, shape) in tensors {
        let begin = end;
        end += 4 * shape.iter().product::<usize>();
        let entry = json!({"dtype": "F32", "shape": shape, "data_offsets": [begin, end]});
        header.insert(name.clone(), entry);
    }
    let header = Value::Object(header).to_string();
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    fs::write(path, &bytes).expect("writes");
    let file = fs::OpenOptions::new()
        .write(true)
        .open(path)
        .expect("opens");
    file.set_len((bytes.len() + end) as u64).expect("has room");
}

fn refused(path: &Path, parts: &[&str]) {
    let error = check(path).expect_err("is refused").to_string();
    for part in parts {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
    assert!(!error.contains('\n'), "{error}");
}

/// Tensors that training needed and inference does not: the coarser levels of the ray branch. The
/// norm of the coarsest is the one that all share.
fn is_unused(name: &str) -> bool {
    let levels = ["0.", "1.", "2."];
    let of = |part: &str| {
        levels
            .iter()
            .any(|level| name.contains(&format!("{part}.{level}")))
    };
    (of("output_conv1_aux") || of("output_conv2_aux")) && !name.contains("output_conv2_aux.0.2.")
}

#[test]
#[ignore = "needs ../shared/prior"]
fn released_files_are_told_and_every_tensor_is_held_to_its_shape() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    for (list, name, channels, n_parameters) in [
        ("tensors_small.txt", "DA3-SMALL", 384, 34_299_463),
        ("tensors_base.txt", "DA3-BASE", 768, 135_366_599),
    ] {
        let tensors = tensors(list);
        write(&path, &tensors);
        let model = check(&path).unwrap_or_else(|e| panic!("{list}: {e}"));
        assert_eq!((model.name().as_str(), model.channels), (name, channels));
        assert_eq!((model.n_heads, model.alt_start), (channels / 64, 4));
        assert_eq!(model.outputs, [5, 7, 9, 11]);
        assert_eq!(model.n_parameters, n_parameters);
        assert!(model.licence_notice().is_none());
        let mut n_unused = 0;
        for i in 0..tensors.len() {
            let mut without = tensors.clone();
            let (lost, _) = without.remove(i);
            write(&path, &without);
            let outcome = check(&path);
            assert_eq!(
                outcome.is_ok(),
                is_unused(&lost),
                "without {lost}: {outcome:?}"
            );
            n_unused += usize::from(is_unused(&lost));
            let mut other = tensors.clone();
            *other[i].1.last_mut().expect("a side") += 1;
            write(&path, &other);
            assert_eq!(
                check(&path).is_ok(),
                is_unused(&lost),
                "another shape of {lost}"
            );
        }
        // Ten of each first convolution, four of each second; the shared norm is used.
        assert_eq!(n_unused, 3 * (10 + 4), "{list}");
    }
}

#[test]
fn without_weights_one_line_says_what_to_download() {
    let dir = tempfile::tempdir().expect("a folder");
    RgbImage::from_fn(20, 20, |x, y| Rgb([x as u8, y as u8, 9]))
        .save(dir.path().join("a.png"))
        .expect("writes");
    for command in ["scene . --out made", "train --photographs ."] {
        let ended = run(dir.path(), command);
        assert_eq!(ended.code, Some(2), "{}", ended.log);
        assert_eq!(ended.log.lines().count(), 1, "{}", ended.log);
        for part in ["no weights", "137 MB", "541 MB", "Apache-2.0", "--weights"] {
            assert!(ended.log.contains(part), "{}", ended.log);
        }
    }
}

#[test]
fn files_that_are_no_weights_are_refused_by_what_they_are() {
    let dir = tempfile::tempdir().expect("a folder");
    refused(dir.path(), &["is not a file", "model.safetensors"]);
    let path = dir.path().join("model.safetensors");
    refused(&path, &["cannot read", "137 MB", "541 MB", "Apache-2.0"]);
    for (bytes, what) in [
        (
            &b"version https://git-lfs.github.com/spec/v1\n"[..],
            "Git LFS pointer",
        ),
        (b"PK\x03\x04........................", "PyTorch checkpoint"),
        (b"<!doctype html><html>..........", "web page"),
        (b"", "fewer than 8 bytes"),
        (b"\xff\xff\xff\xff\xff\xff\xff\xff", "announce a header"),
        (b"\x02\0\0\0\0\0\0\0{}", "no vision transformer"),
        (b"\x02\0\0\0\0\0\0\0[]", "not a safetensors file"),
    ] {
        fs::write(&path, bytes).expect("writes");
        refused(&path, &[what, "download"]);
    }
    let index = dir.path().join("model.safetensors.index.json");
    fs::write(&index, "{}").expect("writes");
    refused(&index, &["in several files", "download"]);
    let shard = dir.path().join("model-00001-of-00002.safetensors");
    fs::write(&shard, "").expect("writes");
    refused(&shard, &["one of several files", "download"]);
    let whole = dir.path().join("model-00001-of-00001.safetensors");
    fs::write(&whole, "").expect("writes");
    refused(&whole, &["fewer than 8 bytes"]);
}

/// The nearest number of IEEE 754's binary16, its bits and its value; ties to even.
fn half(x: f32) -> (u16, f32) {
    let size = f64::from(x.abs()).min(65504.0);
    let exponent = size.log2().floor().max(-14.0);
    let step = (exponent - 10.0).exp2();
    let whole = (size / step).round_ties_even();
    let sign = u16::from(x.is_sign_negative()) << 15;
    // A whole number of 1024 steps begins the exponent's range, 2048 the next one's.
    let bits = match whole as u16 {
        n @ 0..1024 => n,
        n => (((exponent + 14.0) as u16) << 10) + n,
    };
    (sign | bits, (whole * step) as f32 * 1_f32.copysign(x))
}

/// The nearest number with the upper 16 bits of an f32 alone.
fn brief(x: f32) -> (u16, f32) {
    let bits = x.to_bits();
    let upper = ((bits + 0x7fff + (bits >> 16 & 1)) >> 16) as u16;
    (upper, f32::from_bits(u32::from(upper) << 16))
}

/// The tensors with every value by one of the above, in 16 bits and as the f32 that it stands for.
fn rounded(bytes: &[u8], dtype: Dtype, to: fn(f32) -> (u16, f32)) -> [Vec<u8>; 2] {
    let tensors = SafeTensors::deserialize(bytes).expect("is one");
    let mut short = Vec::new();
    let mut long = Vec::new();
    for (name, view) in tensors.tensors() {
        let values = view.data().as_chunks::<4>().0.iter();
        let values: Vec<(u16, f32)> = values.map(|b| to(f32::from_le_bytes(*b))).collect();
        let shape = view.shape().to_vec();
        let bits: Vec<u8> = values.iter().flat_map(|v| v.0.to_le_bytes()).collect();
        let wide: Vec<u8> = values.iter().flat_map(|v| v.1.to_le_bytes()).collect();
        short.push((name.clone(), dtype, shape.clone(), bits));
        long.push((name, Dtype::F32, shape, wide));
    }
    [short, long].map(|tensors| {
        let views = tensors.iter().map(|(name, dtype, shape, data)| {
            let view = TensorView::new(*dtype, shape.clone(), data).expect("fits");
            (name.as_str(), view)
        });
        serialize(views, None).expect("is written")
    })
}

#[test]
#[ignore = "needs ../shared/prior"]
fn weights_in_16_bits_give_what_their_values_give_in_32() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    let bytes = fs::read(golden("tiny.safetensors")).expect("is there");
    assert_eq!((half(1.0), half(-2.0)), ((0x3c00, 1.0), (0xc000, -2.0)));
    assert_eq!(half(5.960_464_5e-8).0, 1);
    let values: Vec<f32> = (0..2 * 3 * 28 * 42).map(|i| (i as f32).sin()).collect();
    let images = Images::from_values(values, 28, 42).expect("two views");
    let depth_of = |bytes: &[u8]| -> Vec<f32> {
        fs::write(&path, bytes).expect("writes");
        let network = Network::read(&path, Outputs::Depth).unwrap_or_else(|e| panic!("{e}"));
        let found = network.predict(&images, None, &mut |_, _| {});
        found
            .views
            .into_iter()
            .flat_map(|view| view.depth)
            .collect()
    };
    let whole = depth_of(&bytes);
    for (dtype, to) in [
        (Dtype::F16, half as fn(f32) -> (u16, f32)),
        (Dtype::BF16, brief),
    ] {
        let [short, long] = rounded(&bytes, dtype, to);
        assert!(short.len() < long.len() * 6 / 10);
        let depth = depth_of(&short);
        assert!(depth == depth_of(&long), "{dtype:?}");
        assert!(depth != whole, "{dtype:?} rounds nothing");
    }
}

#[test]
#[ignore = "needs ../shared/prior"]
fn weights_that_are_no_numbers_are_refused_by_tensor() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    let bytes = fs::read(golden("tiny.safetensors")).expect("is there");
    let tensors = SafeTensors::deserialize(&bytes).expect("is one");
    let data = tensors
        .tensor("model.backbone.pretrained.cls_token")
        .expect("is there");
    let at = data.data().as_ptr() as usize - bytes.as_ptr() as usize;
    let mut damaged = bytes.clone();
    damaged[at + 8..at + 12].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&path, damaged).expect("writes");
    let error = Network::read(&path, Outputs::Depth)
        .err()
        .expect("is refused");
    let error = error.to_string();
    for part in ["cls_token", "value 2 is NaN", "download"] {
        assert!(error.contains(part), "{error}");
    }
    let [mut other, _] = rounded(&bytes, Dtype::F16, half);
    // The same sizes under another name.
    let n = u64::from_le_bytes(*other.first_chunk().expect("a length")) as usize;
    let header = String::from_utf8(other[8..8 + n].to_vec()).expect("JSON");
    let renamed = header.replacen("\"F16\"", "\"I16\"", 1);
    other.splice(8..8 + n, renamed.bytes());
    fs::write(&path, other).expect("writes");
    refused(&path, &["holds I16", "F32, F16 or BF16"]);
}

/// The tensors of DA3-LARGE, by those of DA3-BASE.
fn large(base: &[(String, Vec<usize>)]) -> Vec<(String, Vec<usize>)> {
    let head = |n: usize| match n {
        96 => 256,
        192 => 512,
        384 | 768 => 1024,
        128 => 256,
        64 => 128,
        1536 => 2048,
        n => n,
    };
    let trunk = |n: usize| match n {
        384 | 768 | 1536 | 2304 | 3072 => n / 3 * 4,
        n => n,
    };
    let mut made = Vec::new();
    for (name, shape) in base {
        let side = |n: &usize| match name.starts_with("model.head.") {
            true => head(*n),
            false => trunk(*n),
        };
        let shape: Vec<usize> = shape.iter().map(side).collect();
        let number = |name: &str| {
            let (_, rest) = name.split_once("pretrained.blocks.")?;
            rest.split_once('.')?.0.parse::<usize>().ok()
        };
        let is_norm = name.contains("q_norm") || name.contains("k_norm");
        if !(is_norm && number(name).is_some_and(|i| i < 8)) {
            made.push((name.clone(), shape.clone()));
        }
        if number(name) == Some(11) {
            let copies = (12..24).map(|i| name.replace("blocks.11.", &format!("blocks.{i}.")));
            made.extend(copies.map(|name| (name, shape.clone())));
        }
    }
    made
}

#[test]
#[ignore = "needs ../shared/prior"]
fn larger_models_are_told_with_their_licence() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    let base = tensors("tensors_base.txt");
    write(&path, &large(&base));
    let model = check(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((model.name().as_str(), model.alt_start), ("DA3-LARGE", 8));
    assert_eq!(model.n_parameters, 410_941_767);
    let notice = model.licence_notice().expect("is not free");
    assert!(notice.contains("CC BY-NC 4.0") && notice.contains("not for commercial use"));
    // It is said before anything takes time: the run below ends at the photographs.
    let photograph = dir.path().join("blank.png");
    RgbImage::new(20, 20).save(&photograph).expect("writes");
    let ended = run(
        dir.path(),
        "scene blank.png --weights model.safetensors --out scene",
    );
    let log = &ended.log;
    assert!(
        log.contains(notice) && log.contains("shows nothing"),
        "{log}"
    );
    assert_eq!(ended.code, Some(1));
}

#[test]
#[ignore = "needs ../shared/prior"]
fn weights_that_are_cut_short_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    let bytes = fs::read(golden("tiny.safetensors")).expect("is there");
    for n in [4, 8, 100, 5000, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&path, &bytes[..n]).expect("writes");
        refused(&path, &["model.safetensors", "download"]);
    }
}

#[test]
fn other_models_of_the_family_are_refused_by_name() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("model.safetensors");
    let one = |name: &str| vec![(name.to_owned(), vec![4])];
    for (name, what) in [
        ("model.da3.backbone.pretrained.cls_token", "nested"),
        (
            "model.head.scratch.sky_output_conv2.0.weight",
            "mono or metric",
        ),
        ("encoder.layer.0.weight", "no vision transformer"),
        (
            "backbone.pretrained.blocks.0.norm1.weight",
            "names its tensors otherwise",
        ),
    ] {
        write(&path, &one(name));
        refused(&path, &[what, "download"]);
    }
}
