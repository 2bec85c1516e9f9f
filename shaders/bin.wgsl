// Finds the tiles that each splat reaches: one thread a splat, front to back. Runs twice with the
// same code: `COUNT` counts a splat's tiles, `EMIT` writes its pairs, which are numbered front to
// back, splat by splat.
#import shared/view

const COUNT = 0u;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4f>;
// Per splat, front to back: number of tiles (COUNT), then the first pair (EMIT).
@group(0) @binding(2) var<storage, read_write> splat_pairs: array<u32>;
// (tile, pair).
@group(0) @binding(4) var<storage, read_write> pairs: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> pair_gaussian: array<u32>;
@group(0) @binding(6) var<storage, read> totals: array<u32>;
@group(0) @binding(7) var<uniform> mode: vec4u;
// Per Gaussian (EMIT): its first pair and one past its last.
@group(0) @binding(3) var<storage, read_write> gaussian_pairs: array<vec2u>;
// (key, Gaussian), front to back.
@group(0) @binding(8) var<storage, read> depth_order: array<vec2u>;

@compute @workgroup_size(WORKGROUP)
fn bin(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let rank = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (rank >= view.counts.x) {
        return;
    }
    let counting = mode.x == COUNT;
    if (!counting && totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let id = depth_order[rank].y;
    let s0 = splats[3u * id];
    let s1 = splats[3u * id + 1u];
    var n_pairs = 0u;
    if (s1.w > 0.0) {
        var first = 0u;
        if (!counting) {
            first = splat_pairs[rank];
        }
        // Rounding may not lose a pixel at the rim.
        let reach = s1.w * 1.0001 + 1e-4;
        let inv_yy = 1.0 / s1.x;
        let inv_xx = 1.0 / s0.z;
        // x of the ellipse's axis is slope * dy.
        let slope = -s0.w * inv_xx;
        let half_height = sqrt(reach) * inv_yy;
        // The rightmost point of the ellipse lies at dy = y_right, the leftmost at -y_right.
        let cov_xy = slope * inv_yy * inv_yy;
        let y_right = cov_xy * sqrt(reach / (inv_xx * inv_xx + slope * cov_xy));
        let height = f32(view.size.y);
        let width = f32(view.size.x);
        let top = max(ceil(s0.y - half_height - 0.5 - RIM), 0.0);
        let bottom = min(floor(s0.y + half_height - 0.5 + RIM), height - 1.0);
        if (top <= bottom) {
            let row_0 = u32(top) / TILE_H;
            let row_1 = u32(bottom) / TILE_H;
            for (var row = row_0; row <= row_1; row++) {
                // Pixel centres of this row of tiles, relative to the splat.
                let y_0 = max(f32(row * TILE_H) + 0.5 - s0.y, -half_height);
                let y_1 = min(f32(row * TILE_H + TILE_H) - 0.5 - s0.y, half_height);
                let dy_right = clamp(y_right, min(y_0, y_1), y_1);
                let dy_left = clamp(-y_right, min(y_0, y_1), y_1);
                let t_right = dy_right * s1.x;
                let t_left = dy_left * s1.x;
                let right = slope * dy_right + sqrt(max(reach - t_right * t_right, 0.0)) * inv_xx;
                let left = slope * dy_left - sqrt(max(reach - t_left * t_left, 0.0)) * inv_xx;
                let x_0 = max(ceil(s0.x + left - 0.5 - RIM), 0.0);
                let x_1 = min(floor(s0.x + right - 0.5 + RIM), width - 1.0);
                if (x_0 <= x_1) {
                    let column_0 = u32(x_0) / TILE_W;
                    let column_1 = u32(x_1) / TILE_W;
                    let n_columns = column_1 - column_0 + 1u;
                    for (var i = 0u; i < select(n_columns, 0u, counting); i++) {
                        let pair = first + n_pairs + i;
                        pairs[pair] = vec2u(row * view.size.z + column_0 + i, pair);
                        pair_gaussian[pair] = id;
                    }
                    n_pairs += n_columns;
                }
            }
        }
    }
    if (counting) {
        splat_pairs[rank] = n_pairs;
    } else {
        gaussian_pairs[id] = vec2u(splat_pairs[rank], splat_pairs[rank] + n_pairs);
    }
}
