//! Confidences beside a cloud, as NumPy's arrays.

use super::fixtures::{instantsplat, npy, npy_with, still_life};

#[test]
fn confidences_are_read_from_every_float_array_of_a_vector() {
    let written = still_life();
    let folder = instantsplat(&written);
    let place = "sparse_4/0/confidence_dsp.npy";
    let n = written.cloud.len();
    let values: Vec<f32> = (0..n).map(|i| 1.0 + i as f32).collect();
    let doubles: Vec<u8> = values
        .iter()
        .flat_map(|v| f64::from(*v).to_le_bytes())
        .collect();
    let mut version_2 = b"\x93NUMPY\x02\x00".to_vec();
    let header = format!("{{'shape': ({n},), 'fortran_order': True, 'descr': '<f8'}}");
    version_2.extend((header.len() as u32).to_le_bytes());
    version_2.extend(header.bytes());
    version_2.extend(&doubles);
    for bytes in [
        npy(&values, &format!("({n},)")),
        npy(&values, &format!("({n}, 1)")),
        npy(&values, &format!("(1, {n}, 1)")),
        version_2,
    ] {
        folder.write(place, bytes);
        assert_eq!(folder.scene().cloud.confidence.as_ref(), Some(&values));
    }
    let header = |descr: &str, shape: &str| {
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}")
    };
    let shape = format!("({n},)");
    let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    for (bytes, part) in [
        (b"".to_vec(), "byte 0: not an .npy"),
        (b"\x93NUMPY\x09\x00\x10\x00{}".to_vec(), "version 1 to 3"),
        (
            npy(&values, &shape)[..40].to_vec(),
            "ends within its header",
        ),
        (npy(&values[1..], &shape), "bytes follow the header"),
        (
            npy(&values[1..], &format!("({},)", n - 1)),
            "confidences for a cloud of",
        ),
        (npy(&values, "(2, 3)"), "[2, 3] is not a vector"),
        (npy(&values, "(4294967296,)"), "counts below 2^32"),
        (
            npy(&values, "(4294967295,)"),
            "4294967295 values of 4 bytes",
        ),
        (npy(&values, "(-1,)"), "counts below 2^32"),
        (npy_with(&header("<i4", &shape), &data), "type is `<i4`"),
        (npy_with(&header("|O", &shape), &data), "type is `|O`"),
        (npy_with("{}", &data), "lacks `descr` or `shape`"),
        (npy_with("[]", &data), "is not a dict"),
        (npy_with("{'a': 1, }", &data), "unknown keys"),
        (
            npy_with("{'descr': '<f4', 'shape': 7, }", &data),
            "not a tuple",
        ),
        (npy_with("{'descr': '<f4', shape}", &data), "malformed"),
    ] {
        folder.write(place, bytes);
        folder.fails_with(&["confidence_dsp.npy", part]);
    }
    // Confidences that are not finite drop their points, as in a PLY.
    let mut values = values;
    values[3] = f32::NAN;
    folder.write(place, npy(&values, &shape));
    assert_eq!(folder.scene().cloud.len(), n - 1);
}
