// Sorts each tile's pairs by (depth, Gaussian): one thread a tile, bottom-up merge sort.
//
// Pairs are numbered by Gaussian, so comparing (depth bits, pair) breaks ties by Gaussian, and the
// result does not depend on the order in which the pairs were emitted. Depths are positive, so
// their bits order as they do. Afterwards a key is (Gaussian, pair).
#import shared/view

@group(0) @binding(0) var<uniform> view: View;
// Per tile: one past its last pair (the cursor after EMIT).
@group(0) @binding(1) var<storage, read> tile_cursor: array<u32>;
@group(0) @binding(2) var<storage, read_write> pair_keys: array<vec2u>;
@group(0) @binding(3) var<storage, read_write> pair_scratch: array<vec2u>;
@group(0) @binding(4) var<storage, read> pair_gaussian: array<u32>;
@group(0) @binding(5) var<storage, read> totals: array<u32>;

fn before(a: vec2u, b: vec2u) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

@compute @workgroup_size(WORKGROUP)
fn sort(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let tile = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (tile >= view.size.z * view.size.w || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    var start = 0u;
    if (tile > 0u) {
        start = tile_cursor[tile - 1u];
    }
    let end = tile_cursor[tile];

    // Runs of SORT_RUN by insertion.
    for (var run = start; run < end; run += SORT_RUN) {
        let run_end = min(run + SORT_RUN, end);
        for (var i = run + 1u; i < run_end; i++) {
            let key = pair_keys[i];
            var j = i;
            while (j > run) {
                let other = pair_keys[j - 1u];
                if (!before(key, other)) {
                    break;
                }
                pair_keys[j] = other;
                j--;
            }
            pair_keys[j] = key;
        }
    }

    var in_keys = true;
    for (var width = SORT_RUN; width < end - start; width *= 2u) {
        for (var left = start; left < end; left += 2u * width) {
            let middle = min(left + width, end);
            let right = min(left + 2u * width, end);
            var i = left;
            var j = middle;
            var a = load(in_keys, i);
            var b = load(in_keys, min(j, end - 1u));
            for (var k = left; k < right; k++) {
                if (i < middle && (j >= right || before(a, b))) {
                    store(!in_keys, k, a);
                    i++;
                    a = load(in_keys, min(i, end - 1u));
                } else {
                    store(!in_keys, k, b);
                    j++;
                    b = load(in_keys, min(j, end - 1u));
                }
            }
        }
        in_keys = !in_keys;
    }

    for (var i = start; i < end; i++) {
        let pair = load(in_keys, i).y;
        pair_keys[i] = vec2u(pair_gaussian[pair], pair);
    }
}

fn load(in_keys: bool, i: u32) -> vec2u {
    if (in_keys) {
        return pair_keys[i];
    }
    return pair_scratch[i];
}

fn store(in_keys: bool, i: u32, key: vec2u) {
    if (in_keys) {
        pair_keys[i] = key;
    } else {
        pair_scratch[i] = key;
    }
}
