//! Scans and radix sorts at the sizes where they change their way, and beyond what they count to.

use gspotential::doctor::twin::random::Random;
use gspotential::doctor::{Context, Finding, Rig, sorts};
use gspotential::gpu::constants::{
    GROUP_RADIX_CHUNK, RADIX_CHUNK, SCAN_CHUNK, SCAN_FEW, WORKGROUP,
};
use gspotential::gpu::{Commands, Rasterizer};
use gspotential::render::Pass;

use super::rig::context_of;

/// Counts that one workgroup scans alone.
const FEW: usize = (SCAN_FEW * SCAN_CHUNK * WORKGROUP) as usize;

/// Entries of a sort by workgroups whose digits are scanned in more than one round.
const MANY: usize = 4 * (WORKGROUP * GROUP_RADIX_CHUNK) as usize + 1;

/// Around a vector of counts, a chunk, a block, and the most that are scanned in one dispatch.
const SIZES: [usize; 13] = [
    1,
    3,
    SCAN_CHUNK as usize + 1,
    RADIX_CHUNK as usize - 1,
    GROUP_RADIX_CHUNK as usize - 1,
    GROUP_RADIX_CHUNK as usize,
    GROUP_RADIX_CHUNK as usize + 1,
    (SCAN_CHUNK * WORKGROUP) as usize,
    (SCAN_CHUNK * WORKGROUP) as usize + 1,
    FEW - 1,
    FEW,
    FEW + 1,
    70_001,
];

/// Every size with every rasterizer.
fn every_size() -> impl Iterator<Item = (Rasterizer, usize)> {
    let all = Rasterizer::ALL.into_iter();
    all.flat_map(|rasterizer| SIZES.map(|n| (rasterizer, n)))
}

fn run(ctx: &Context, rig: &Rig, record: fn(&Pass<'_>, &mut Commands<'_>)) {
    let mut commands = Commands::new(&ctx.gpu);
    record(&rig.pass(ctx), &mut commands);
    commands.submit();
}

#[test]
fn scans_of_all_sizes_are_the_sums_before() {
    for (rasterizer, n) in every_size() {
        let ctx = context_of(rasterizer);
        let rig = sorts::rig(&ctx, n).expect("fits");
        let mut random = Random::new(n as u64);
        let counts: Vec<u32> = (0..n).map(|_| random.uniform(0.0, 9.0) as u32).collect();
        rig.start(&ctx);
        rig.buffer("splat_pairs").write(&ctx.gpu, &counts);
        run(&ctx, &rig, |pass, commands| pass.scan_pairs(commands));
        let firsts: Vec<u32> = rig.read(&ctx, "splat_pairs", n).expect("readable");
        let mut sum = 0;
        for (i, (first, count)) in firsts.iter().zip(&counts).enumerate() {
            assert_eq!(*first, sum, "{i} of {n}");
            sum += count;
        }
        let totals: Vec<u32> = rig.read(&ctx, "totals", 4).expect("readable");
        assert_eq!(totals[0], sum, "{n}");
    }
}

#[test]
fn a_total_beyond_32_bits_is_the_largest_number_and_too_many() {
    let sizes = [FEW, FEW + 1].map(|n| Rasterizer::ALL.map(|rasterizer| (rasterizer, n)));
    for (rasterizer, n) in sizes.into_iter().flatten() {
        let ctx = context_of(rasterizer);
        let rig = sorts::rig(&ctx, n).expect("fits");
        rig.start(&ctx);
        let counts = vec![u32::MAX / (n as u32 - 1); n];
        rig.buffer("splat_pairs").write(&ctx.gpu, &counts);
        run(&ctx, &rig, |pass, commands| pass.scan_pairs(commands));
        let totals: Vec<u32> = rig.read(&ctx, "totals", 4).expect("readable");
        assert_eq!((totals[0], totals[2], totals[3]), (u32::MAX, 1, u32::MAX));
    }
}

#[test]
fn sorts_of_all_sizes_are_stable() {
    for (rasterizer, n) in every_size().chain([(Rasterizer::Workgroup, MANY)]) {
        let ctx = context_of(rasterizer);
        let findings = sorts::examine(&ctx, n).expect("computes").list;
        assert!(findings.iter().all(Finding::holds), "{n}");
    }
}
