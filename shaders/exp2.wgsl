// Takes 2^x of many exponents as the rasterizers do, so that the host can hold it to exact powers.
#import shared/thread
#import shared/tile

@group(0) @binding(0) var<storage, read> exponents: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> powers: array<vec4f>;

@compute @workgroup_size(WORKGROUP)
fn exp2_of_all(thread: Thread) {
    let i = thread_index(thread);
    if (i < arrayLength(&exponents)) {
        powers[i] = exp2_negative(exponents[i]);
    }
}
