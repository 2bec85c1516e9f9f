//! Every loop of every kernel has a bound, and says which: Mesa's CPU driver ends loops that take
//! more than 65,535 turns together, in silence.

use gspotential::gpu::Rasterizer;
use gspotential::gpu::constants::MOST_TILE_ROWS;
use gspotential::gpu::shader::{STAGES, compose};
use gspotential::render::{Capacity, Workspace};

use super::rig::context_of;

/// Whether a line of WGSL begins a loop.
fn is_loop(line: &str) -> bool {
    let line = line.trim_start();
    ["for ", "for(", "while ", "while(", "loop ", "loop{"]
        .iter()
        .any(|word| line.starts_with(word))
}

/// Lines of loops without a `// bound: ...` in the comment right above them.
fn unbounded(source: &str) -> Vec<usize> {
    let lines: Vec<&str> = source.lines().collect();
    let is_bounded = |at: usize| {
        let above = lines[..at].iter().rev();
        let mut comment = above.take_while(|line| line.trim_start().starts_with("//"));
        comment.any(|line| {
            let bound = line.trim_start().strip_prefix("// bound: ");
            bound.is_some_and(|bound| !bound.trim().is_empty())
        })
    };
    let loops = (0..lines.len()).filter(|at| is_loop(lines[*at]));
    loops.filter(|at| !is_bounded(*at)).collect()
}

/// Loops of a block of naga's and of those within it.
fn n_loops(block: &naga::Block) -> usize {
    let of_statement = |statement: &naga::Statement| match statement {
        naga::Statement::Block(inner) => n_loops(inner),
        naga::Statement::If { accept, reject, .. } => n_loops(accept) + n_loops(reject),
        naga::Statement::Switch { cases, .. } => cases.iter().map(|case| n_loops(&case.body)).sum(),
        naga::Statement::Loop {
            body, continuing, ..
        } => 1 + n_loops(body) + n_loops(continuing),
        _ => 0,
    };
    block.iter().map(of_statement).sum()
}

#[test]
fn every_loop_of_every_kernel_states_its_bound() {
    let mut n_all = 0;
    for (stage, _) in STAGES {
        let source = compose(stage, 3);
        let module = naga::front::wgsl::parse_str(&source).expect("parses");
        let functions = module.functions.iter().map(|(_, function)| function);
        let points = module.entry_points.iter().map(|point| &point.function);
        let n: usize = functions.chain(points).map(|f| n_loops(&f.body)).sum();
        let seen = source.lines().filter(|line| is_loop(line)).count();
        assert_eq!(
            seen, n,
            "{stage}: the text has other loops than the program"
        );
        let lines: Vec<&str> = source.lines().collect();
        let bare: Vec<&str> = unbounded(&source).iter().map(|at| lines[*at]).collect();
        assert!(bare.is_empty(), "{stage}: no bound is stated for {bare:#?}");
        // The check sees a statement that is gone, and an empty one.
        for planted in [
            source.replace("// bound: ", "// "),
            source
                .lines()
                .map(|line| line.split("bound: ").next().unwrap_or_default())
                .collect::<Vec<_>>()
                .join("\n"),
        ] {
            assert_eq!(unbounded(&planted).len(), n, "{stage}");
        }
        n_all += n;
    }
    assert!(n_all > 20, "{n_all} loops");
}

#[test]
fn an_image_too_tall_for_the_loops_is_refused_with_the_numbers() {
    for rasterizer in Rasterizer::ALL {
        let ctx = context_of(rasterizer);
        let (most, height) = (MOST_TILE_ROWS as usize, rasterizer.tile()[1] as usize);
        let room = |tile_rows: usize| Capacity {
            tile_rows,
            ..Capacity::new(rasterizer, 1, 1, &[])
        };
        let refused = Workspace::new(&ctx.gpu, room(most + 1), false).err();
        let text = refused.expect("too tall").to_string();
        for part in [
            ((most + 1) * height).to_string(),
            (most * height).to_string(),
            "--max-size".into(),
        ] {
            assert!(text.contains(&part), "{text}");
        }
        Workspace::new(&ctx.gpu, room(most), false).expect("just fits");
    }
}
