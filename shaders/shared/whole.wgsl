// 1.5 2^23. A whole number of less than 2^22 stands in the low bits of its sum with this. Conversions of floats to integers
// hold what is too large or not a number to the integers' bounds: Mesa 25's llvmpipe does that lane by lane, which took a third
// of the forward rasterizer's time.
const WHOLE = 12582912.0;

// The integer that `x` is, if that is whole and from 0 to 2^22.
fn whole(x: f32) -> u32 {
    return bitcast<u32>(x + WHOLE) - 0x4b400000u;
}
