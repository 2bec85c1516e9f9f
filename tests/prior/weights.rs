//! Files of weights: those released, tensor by tensor, and files that are none.

use std::fs;
use std::path::Path;

use gspotential::prior::check;
use serde_json::{Map, Value, json};

use super::golden;

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
fn files_that_are_no_weights_are_refused_by_what_they_are() {
    let dir = tempfile::tempdir().expect("a folder");
    refused(dir.path(), &["is no file", "model.safetensors"]);
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
        (b"\x02\0\0\0\0\0\0\0[]", "no safetensors file"),
    ] {
        fs::write(&path, bytes).expect("writes");
        refused(&path, &[what, "download"]);
    }
    let index = dir.path().join("model.safetensors.index.json");
    fs::write(&index, "{}").expect("writes");
    refused(&index, &["in several files", "download"]);
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
