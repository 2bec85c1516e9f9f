// Composites each tile's splats front to back: one thread a tile, four pixels a vec4f.
//
// alpha = min(ALPHA_MAX, opacity 2^-|t|^2); alpha < ALPHA_MIN is skipped; a splat that would take
// the transmittance to TRANSMITTANCE_MIN or below is not blended and ends its pixel.
#import shared/view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> splats: array<vec4f>;
@group(0) @binding(2) var<storage, read> tile_cursor: array<u32>;
@group(0) @binding(3) var<storage, read> pair_keys: array<vec2u>;
// Planes r, g, b, final transmittance.
@group(0) @binding(4) var<storage, read_write> rendered: array<vec4f>;
// Per pixel: one past the last blended splat, counted from its tile's first.
@group(0) @binding(5) var<storage, read_write> last_blended: array<vec4u>;
@group(0) @binding(6) var<storage, read> totals: array<u32>;

#import shared/tile

@compute @workgroup_size(WORKGROUP)
fn rasterize(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let tile = (group.y * groups.x + group.x) * WORKGROUP + local;
    if (tile >= view.size.z * view.size.w || totals[TOTAL_OVERFLOW] != 0u) {
        return;
    }
    let stride = view.counts.y;
    let x4 = tile % view.size.z;
    let y = (tile / view.size.z) * TILE_H;
    let px = vec4f(0.5, 1.5, 2.5, 3.5) + f32(4u * x4);
    let py = f32(y) + 0.5;
    var red: array<vec4f, TILE_H>;
    var green: array<vec4f, TILE_H>;
    var blue: array<vec4f, TILE_H>;
    var transmittance: array<vec4f, TILE_H>;
    // Transmittance of pixels that still take splats, 0 elsewhere.
    var open: array<vec4f, TILE_H>;
    var last: array<vec4u, TILE_H>;
    for (var r = 0u; r < TILE_H; r++) {
        transmittance[r] = vec4f(1.0);
        open[r] = vec4f(1.0);
    }

    let range = tile_range(tile);
    for (var i = range.x; i < range.y; i++) {
        let id = pair_keys[i].x;
        let s0 = splats[id];
        let s1 = splats[stride + id];
        let color = splats[2u * stride + id];
        let dx = px - s0.x;
        let number = vec4u(i - range.x + 1u);
        var any_open = vec4f(0.0);
        for (var r = 0u; r < TILE_H; r++) {
            let dy = py + f32(r) - s0.y;
            let t_y = s1.x * dy;
            let t_x = s0.z * dx + s0.w * dy;
            let alpha = min(vec4f(ALPHA_MAX), s1.y * exp2_negative(-(t_x * t_x + t_y * t_y)));
            let next = open[r] * (1.0 - alpha);
            let drawn = alpha >= vec4f(ALPHA_MIN);
            let kept = next > vec4f(TRANSMITTANCE_MIN);
            let blended = drawn & kept;
            let weight = select(vec4f(0.0), alpha * open[r], blended);
            red[r] += color.x * weight;
            green[r] += color.y * weight;
            blue[r] += color.z * weight;
            transmittance[r] = select(transmittance[r], next, blended);
            last[r] = select(last[r], number, blended);
            open[r] = select(select(open[r], vec4f(0.0), drawn), next, blended);
            any_open += open[r];
        }
        if (all(any_open == vec4f(0.0))) {
            break;
        }
    }

    for (var r = 0u; r < TILE_H; r++) {
        let t = transmittance[r];
        rendered[plane_index(view, 0u, x4, y + r)] = red[r] + view.background.x * t;
        rendered[plane_index(view, 1u, x4, y + r)] = green[r] + view.background.y * t;
        rendered[plane_index(view, 2u, x4, y + r)] = blue[r] + view.background.z * t;
        rendered[plane_index(view, 3u, x4, y + r)] = t;
        last_blended[plane_index(view, 0u, x4, y + r)] = last[r];
    }
}
