//! Comparisons. A value that is not finite on either side never passes, nor does a length that
//! differs.

/// Returns `|a - b| / |b|` in L2, `|a|` if `b` is 0; infinite if a value is not finite.
///
/// # Panics
/// If the lengths differ: a fault in this program.
pub fn relative_l2(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "compared arrays differ in length");
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| a - b));
    let reference = norm(&mut b.iter().copied());
    let result = difference / if reference > 0.0 { reference } else { 1.0 };
    if result.is_nan() {
        f64::INFINITY
    } else {
        result
    }
}

/// Returns the largest `|a - b|` over the pixels that `mask` leaves out; arrays are pixel-major
/// with any number of channels.
///
/// # Panics
/// If the lengths differ or do not fit the mask: a fault in this program.
pub fn max_abs_off_mask(a: &[f64], b: &[f64], mask: &[bool]) -> f64 {
    assert_eq!(a.len(), b.len(), "compared arrays differ in length");
    assert!(
        !mask.is_empty() && a.len().is_multiple_of(mask.len()),
        "the mask does not fit the image"
    );
    let channels = a.len() / mask.len();
    let mut worst = 0.0;
    for (pixel, (a, b)) in a.chunks(channels).zip(b.chunks(channels)).enumerate() {
        for (a, b) in a.iter().zip(b).filter(|_| !mask[pixel]) {
            let difference = (a - b).abs();
            worst = if difference.is_finite() {
                difference.max(worst)
            } else {
                f64::INFINITY
            };
        }
    }
    worst
}

/// Returns [`relative_l2`], or infinity if a comparison with `tolerance` would not have seen the
/// largest value with its sign turned, or a NaN in its place: one that cannot fail says nothing.
pub fn held_l2(ours: &[f64], reference: &[f64], tolerance: f64) -> f64 {
    let largest =
        (0..reference.len()).max_by(|&a, &b| reference[a].abs().total_cmp(&reference[b].abs()));
    let Some(i) = largest else {
        return 0.0;
    };
    let mut altered = ours.to_vec();
    for value in [if reference[i] == 0.0 { 1.0 } else { -ours[i] }, f64::NAN] {
        altered[i] = value;
        if relative_l2(&altered, reference) <= tolerance {
            return f64::INFINITY;
        }
    }
    relative_l2(ours, reference)
}

/// Returns [`max_abs_off_mask`], or infinity if a comparison with `tolerance` would not have seen a
/// pixel that is off by twice as much.
pub fn held_off_mask(ours: &[f64], reference: &[f64], mask: &[bool], tolerance: f64) -> f64 {
    if let Some(pixel) = mask.iter().position(|masked| !masked) {
        let i = pixel * ours.len() / mask.len();
        let mut altered = ours.to_vec();
        altered[i] = reference[i] + 2.0 * tolerance;
        if max_abs_off_mask(&altered, reference, mask) <= tolerance {
            return f64::INFINITY;
        }
    }
    max_abs_off_mask(ours, reference, mask)
}
