//! Slips in the kernels, each with the stage that must notice it.

use gspotential::doctor::stage;
use gspotential::gpu::Rasterizer;

/// What is replaced in a stage's complete source, and the stages that must notice it, the first
/// of them first.
pub(crate) struct Plant {
    pub(crate) stage: &'static str,
    pub(crate) from: &'static str,
    pub(crate) to: &'static str,
    pub(crate) noticed: &'static str,
}

impl Plant {
    /// The rasterizer that runs the stage.
    pub(crate) fn rasterizer(&self) -> Rasterizer {
        match self.stage.ends_with("_workgroup") {
            true => Rasterizer::Workgroup,
            false => Rasterizer::Thread,
        }
    }

    /// Whether a stage is another rasterizer's.
    pub(crate) fn is_elsewhere(&self, stage: &str) -> bool {
        let others = Rasterizer::ALL
            .into_iter()
            .filter(|r| *r != self.rasterizer());
        others.map(stage::own).any(|own| own.all().contains(&stage))
    }
}

const fn plant(
    stage: &'static str,
    from: &'static str,
    to: &'static str,
    noticed: &'static str,
) -> Plant {
    Plant {
        stage,
        from,
        to,
        noticed,
    }
}

/// Slips of the kind that happens: a constant, a sign, an index.
pub(crate) const PLANTS: [Plant; 107] = [
    plant(
        "project",
        "+ DILATION;",
        "+ 1.001 * DILATION;",
        stage::PROJECT,
    ),
    plant("project", "* 277803737u;", "* 277803735u;", stage::PROJECT),
    plant(
        "project",
        "max(bitcast<u32>(abs(distance)), least)",
        "max(bitcast<u32>(abs(distance)) & 0xfffff000u, least)",
        stage::PROJECT,
    ),
    plant(
        "project",
        "select(middle + size, middle - size,",
        "select(middle - size, middle + size,",
        stage::PROJECT,
    ),
    plant(
        "project",
        "return Double(sum, b - opaque(sum - a));",
        "return Double(sum, vec3f(0.0));",
        stage::PROJECT,
    ),
    plant(
        "project",
        " - view.center_low",
        " + view.center_low",
        stage::RASTERIZE,
    ),
    plant(
        "project",
        "shear = exact_shear(g, o, r);",
        "shear = r.hi.x - (b / cov_yy) * r.hi.y;",
        stage::RASTERIZE,
    ),
    plant(
        "project_backward",
        "return Double(sum, b - opaque(sum - a));",
        "return Double(sum, vec3f(0.5));",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "radix",
        "counters += one(digits.x);\n        if",
        "counters += one(digits.x ^ 1u);\n        if",
        stage::RADIX_SORT,
    ),
    plant(
        "bin",
        "floor(o.anchor.x + right",
        "floor(o.anchor.x + 0.5 * right",
        stage::BIN,
    ),
    plant(
        "scan",
        "counts[i / 4u] = vec4u(sum, y, z, w);",
        "counts[i / 4u] = vec4u(sum, y, z, w + c.w);",
        stage::SCAN,
    ),
    plant(
        "tile_ranges",
        "TileSplat(pair_gaussian[entry.pair], entry.pair)",
        "TileSplat(pair_gaussian[i], entry.pair)",
        stage::TILE_RANGES,
    ),
    plant(
        "tile_ranges",
        "tile_ranges[before].end = i;",
        "tile_ranges[before].end = i - 1u;",
        stage::TILE_RANGES,
    ),
    plant(
        "tile_ranges",
        "tile_ranges[before].end = n;",
        "tile_ranges[before].end = n - 1u;",
        stage::TILE_RANGES,
    ),
    plant(
        "tile_ranges",
        "other == length && i < thread.local",
        "other == length && i > thread.local",
        stage::TILE_ORDER,
    ),
    plant(
        "exp2",
        "p = p * f + EXP2_C2;",
        "p = p * f + 1.00001 * EXP2_C2;",
        stage::EXP2,
    ),
    plant(
        "rasterize",
        "raw >= vec4f(ALPHA_MIN)",
        "raw >= vec4f(2.0 * ALPHA_MIN)",
        stage::RASTERIZE,
    ),
    plant(
        "bin_workgroup",
        "floor(o.anchor.x + right",
        "floor(o.anchor.x + 0.5 * right",
        stage::BIN_WORKGROUP,
    ),
    plant(
        "bin_workgroup",
        "tile & (DIGITS - 1u)",
        "tile & (DIGITS - 2u)",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "bin_workgroup",
        "n_chunks(totals[TOTAL_PAIRS]);",
        "n_chunks(totals[TOTAL_PAIRS] + CHUNK);",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "rasterize_workgroup",
        "raw >= vec4f(ALPHA_MIN)",
        "raw >= vec4f(2.0 * ALPHA_MIN)",
        stage::RASTERIZE_WORKGROUP,
    ),
    plant(
        "rasterize_workgroup",
        "atomicMax(&last_open, begin + 1u)",
        "atomicMax(&last_open, begin)",
        stage::RASTERIZE_WORKGROUP,
    ),
    plant(
        "rasterize_workgroup",
        "if (thread.local < n)",
        "if (thread.local + 1u < n)",
        stage::RASTERIZE_WORKGROUP,
    ),
    plant(
        "rasterize_backward_workgroup",
        "vec4f(row_x * t_y,",
        "vec4f(row_v * t_y,",
        stage::RASTERIZE_BACKWARD_WORKGROUP,
    ),
    plant(
        "rasterize_backward_workgroup",
        "leaves[local * BRANCHES + 6u + 1u]",
        "leaves[local * BRANCHES + 5u + 1u]",
        stage::RASTERIZE_BACKWARD_WORKGROUP,
    ),
    plant(
        "rasterize_backward_workgroup",
        "staged_pairs[number]",
        "staged_pairs[j]",
        stage::RASTERIZE_BACKWARD_WORKGROUP,
    ),
    plant(
        "rasterize_backward_workgroup",
        "let number = j - round * TREES + tree;",
        "let number = j + tree;",
        stage::RASTERIZE_BACKWARD_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "block[padded(to_15)] = e_15;",
        "block[padded(to_15)] = e_14;",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "sort_half(thread.local, 20u);",
        "",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "sum_of_all << 16u",
        "0u",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "digit_counts[row + at + 0u] = own;",
        "digit_counts[row + at + 0u] = own + 1u;",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "let count_1 = digit_counts[DIGITS * n_blocks + own + 1u];",
        "let count_1 = digit_counts[DIGITS * n_blocks + own];",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "+ to / CHUNK], 1u)",
        "+ number], 1u)",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "radix_workgroup",
        "atomicStore(&next_counts[row + at + 0u], 0u);",
        "",
        stage::RADIX_SORT_WORKGROUP,
    ),
    plant(
        "scan_workgroup",
        "- step], local >= step);",
        "- step], local > step);",
        stage::SCAN_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "(var_both + SSIM_C2)",
        "(var_both + 1.01 * SSIM_C2)",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "four(window_own[at]) + d_e * (about - window_residual[at / 2u]);",
        "four(window_own[at]);",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "d_e[2] * (residual - about);",
        "0.0;",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "(stretch - 1u) ^ 1u",
        "stretch ^ 1u",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "d_rendered[entry(3u, x, y)]",
        "d_rendered[entry(2u, x, y)]",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "column_e[local + half][0];",
        "column_e[local + half - 1u][0];",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "vec4f(0.0), 1.0 / norm, weight >",
        "vec4f(0.0), vec4f(1.0), weight >",
        stage::MASKED_LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "is_masked = true;",
        "",
        stage::MASKED_LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "ring_texel[5] = ring_texel[5u + LOSS_TURN];",
        "ring_texel[5] = ring_texel[6u + LOSS_TURN];",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "ring_gradient[3] = ring_gradient[3u + LOSS_TURN];",
        "",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "strip.y - 12 +",
        "strip.y - 13 +",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "column < LOSS_MARGIN + LOSS_STRIP;",
        "column <= LOSS_MARGIN + LOSS_STRIP;",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "is_own_row && is_own(4u * stretch + 2u)",
        "is_own_row",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "at >= strip.y && at < strip.end",
        "at < strip.end",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "min(y + LOSS_ROWS, rows)",
        "min(y + LOSS_ROWS - 1u, rows)",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim",
        "(var_both + SSIM_C2)",
        "(var_both + 1.01 * SSIM_C2)",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "* (1.0 / LEVEL_MAX);\n    let weight = select(masked,",
        "* (1.0 / LEVEL_MAX);\n    let weight = select(ceil(masked),",
        stage::MASKED_LOSS,
    ),
    plant(
        "ssim",
        "d_rendered[plane_index(view, 3u, at.x4, y)]",
        "d_rendered[plane_index(view, 2u, at.x4, y)]",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "rows[2].d_e * (residual - rows[2].residual)",
        "rows[2].d_e * (residual - rows[3].residual)",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "row[2].residual - row[4].residual",
        "row[2].residual - row[3].residual",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "= about.x + mean_e;",
        "= 1.0001 * about.x + mean_e;",
        stage::LOSS,
    ),
    plant("ssim", "i32(at.x4) - 2;", "i32(at.x4) - 1;", stage::LOSS),
    plant(
        "ssim",
        "i32(at.y) - REACH;",
        "i32(at.y) - REACH + 1;",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "min(x4 + SSIM_ACROSS, view.row_vectors)",
        "min(x4 + SSIM_ACROSS - 1u, view.row_vectors)",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "min(y + SSIM_ROWS, padded_rows())",
        "min(y + SSIM_ROWS - SSIM_TURN, padded_rows())",
        stage::LOSS,
    ),
    plant(
        "ssim_workgroup",
        "far_gradient(vec4u(texel), vec4f(e))",
        "own_weight_of(texel) * far_gradient(vec4u(texel), vec4f(-e))",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim_workgroup",
        "vec4u(24u)) > vec4u(0u)",
        "vec4u(24u)) > vec4u(FAR_ALPHA)",
        stage::LOSS_WORKGROUP,
    ),
    plant(
        "ssim",
        "== vec4u(FAR_ALPHA)",
        ">= vec4u(FAR_ALPHA)",
        stage::LOSS,
    ),
    plant(
        "ssim",
        "at.x4, rendered[plane_index(view, 3u, at.x4, y)]",
        "at.x4, rendered[plane_index(view, 3u, at.x4, max(y, 1u) - 1u)]",
        stage::LOSS,
    ),
    plant(
        "loss_sum",
        "loss.mean_scale * sum.yx",
        "1.0001 * loss.mean_scale * sum.yx",
        stage::LOSS,
    ),
    plant(
        "rasterize_backward",
        "sum_xy += row_x * t_y;",
        "sum_xy += row_v * t_y;",
        stage::RASTERIZE_BACKWARD,
    ),
    plant(
        "bin",
        "return splat_pairs[rank + 1u];",
        "return splat_pairs[rank];",
        stage::BIN,
    ),
    plant(
        "bin",
        "max(chunk, first + EMIT_CHUNK)",
        "max(chunk, first + EMIT_CHUNK + 1u)",
        stage::RADIX_SORT,
    ),
    plant(
        "bin",
        "select(first, chunk, rest) + EMIT_CHUNK",
        "select(first, chunk, rest) + EMIT_CHUNK - 1u",
        stage::RADIX_SORT,
    ),
    plant(
        "sum_pairs",
        "pair < first + size;",
        "pair < first + size - stride;",
        stage::SUM_PAIRS,
    ),
    plant(
        "sum_pairs",
        "sum_block(thread_index(thread) / PAIR_BLOCK, PAIR_BLOCK);",
        "",
        stage::SUM_PAIRS,
    ),
    plant(
        "sum_pairs",
        "first + size - 1u]",
        "first + size / 2u]",
        stage::SUM_PAIRS,
    ),
    plant(
        "sum_pairs",
        "left >= PAIR_BLOCK)",
        "left > PAIR_BLOCK / 2u)",
        stage::SUM_PAIRS,
    ),
    plant(
        "sum_pairs",
        "d.v * (1.0 - kept_share(view) * s.opacity)",
        "d.v * s.opacity",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "sum_pairs",
        "1.0 - kept_share(view) * s.opacity",
        "1.0 - s.opacity",
        stage::PROJECT_BACKWARD,
    ),
    plant(
        "pose_backward",
        "d_mean -= color_to_mean",
        "d_mean += color_to_mean",
        stage::POSE_BACKWARD,
    ),
    plant(
        "pose_backward",
        "+ 0.5 * torque",
        "+ torque",
        stage::POSE_BACKWARD,
    ),
    plant(
        "pose_backward",
        "shifts[0] * w)",
        "w * shifts[0])",
        stage::POSE_BACKWARD,
    ),
    plant(
        "project_depth",
        "s.y < least",
        "s.y > least",
        stage::PROJECT_DEPTH,
    ),
    plant(
        "rasterize_depth",
        "(*p).mode = select((*p).mode, vec4f(f.w), is_mode);",
        "(*p).mode = select(vec4f(f.w), vec4f(f.w), is_mode);",
        stage::RASTERIZE_DEPTH,
    ),
    plant(
        "rasterize_depth",
        "(next <= vec4f(0.5))",
        "(next <= vec4f(0.4))",
        stage::RASTERIZE_DEPTH,
    ),
    plant(
        "rasterize_depth_workgroup",
        "staged_depths[thread.local] = splat_depths[gaussian];",
        "staged_depths[thread.local] = splat_depths[begin];",
        stage::RASTERIZE_DEPTH_WORKGROUP,
    ),
    plant(
        "depth_loss",
        "let both = a.m * share;",
        "let both = a.m;",
        stage::DEPTH_LOSS,
    ),
    plant(
        "depth_loss",
        "+ offset - sign(error)",
        "- sign(error)",
        stage::DEPTH_LOSS,
    ),
    plant(
        "depth_loss",
        "-(s.x * s.x) * d_x",
        "-s.x * d_x",
        stage::DEPTH_LOSS,
    ),
    plant(
        "rasterize_depth_backward",
        "select(-t * fourth, fourth, goes_on)",
        "select(t * fourth, fourth, goes_on)",
        stage::RASTERIZE_DEPTH_BACKWARD,
    ),
    plant(
        "rasterize_depth_backward",
        "d_pair_a[pair] += vec4f(sum_v,",
        "d_pair_a[pair] = vec4f(sum_v,",
        stage::RASTERIZE_DEPTH_BACKWARD,
    ),
    plant(
        "rasterize_depth_backward",
        "(of_median + of_mode)",
        "of_median",
        stage::RASTERIZE_DEPTH_BACKWARD,
    ),
    plant(
        "rasterize_depth_backward_workgroup",
        "d_pair_b[pair] += sum;",
        "d_pair_b[pair] = sum;",
        stage::RASTERIZE_DEPTH_BACKWARD_WORKGROUP,
    ),
    plant(
        "rasterize_depth_backward_workgroup",
        "let part = local % 3u;",
        "let part = min(local % 3u, 1u);",
        stage::RASTERIZE_DEPTH_BACKWARD_WORKGROUP,
    ),
    plant(
        "project_depth_backward",
        "pair < first + size;",
        "pair < first + size - stride;",
        stage::PROJECT_DEPTH_BACKWARD,
    ),
    plant(
        "project_depth_backward",
        "n.side * (d.x",
        "(d.x",
        stage::PROJECT_DEPTH_BACKWARD,
    ),
    plant(
        "adam",
        "step.new_share_2 * (gradient * gradient)",
        "step.new_share_1 * (gradient * gradient)",
        stage::ADAM,
    ),
    plant(
        "adam",
        "vec4f(0.0), frozen)",
        "vec4f(0.0), frozen && plane > 0u)",
        stage::ADAM,
    ),
    plant("adam", " - step.views[0].center_low", "", stage::ADAM),
    plant(
        "adam",
        "1.0 + statistics[id].w;",
        "statistics[id].w;",
        stage::ADAM,
    ),
    plant("adam", ", plane == 0u);", ", plane == 1u);", stage::ADAM),
    plant("adam", "* exp(least);", "* exp(1.01 * least);", stage::ADAM),
    plant(
        "adam",
        " && seen.radius > 0.0) {\n            gradient",
        ") {\n            gradient",
        stage::ADAM,
    ),
    plant(
        "rearrange",
        "vec4f(vec3f(0.0), value.w)",
        "vec4f(0.0)",
        stage::REARRANGE,
    ),
    plant(
        "rearrange",
        "new_planes[plane * rearrange.new_stride + id]",
        "new_planes[plane * rearrange.old_stride + id]",
        stage::REARRANGE,
    ),
    plant(
        "reset_opacity",
        "> reset.frozen_beyond",
        "> 1.1 * reset.frozen_beyond",
        stage::RESET_OPACITY,
    ),
    plant(
        "reset_opacity",
        "second_moment[id].w = 0.0;",
        "second_moment[id].x = 0.0;",
        stage::RESET_OPACITY,
    ),
    plant(
        "exchange",
        "color * LEVEL_MAX + 0.5",
        "color * LEVEL_MAX",
        stage::EXCHANGE,
    ),
    plant(
        "exchange",
        "levels(2u, i) << vec4u(16u)",
        "levels(1u, i) << vec4u(16u)",
        stage::EXCHANGE,
    ),
    plant("exchange", "| vec4u(0xff000000u)", "", stage::EXCHANGE),
    plant("exchange", "min(a, b) == 0u", "a == 0u", stage::EXCHANGE),
];
