//! Damaged files, pipes and links.

use std::process::Command;

use gspotential::scene::Scene;

use super::build::Folder;
use super::fixtures::{
    blender, gaussianobject, instant_ngp, instantsplat, mast3r, pinhole, still_life, vggt, views,
    write_colmap, write_images,
};

/// The format files of one fixture.
type Files = (fn(&Scene) -> Folder, &'static [&'static str]);

#[test]
fn damaged_files_of_any_format_are_errors_of_one_line() {
    let written = still_life();
    let fixtures: [Files; 5] = [
        (
            instantsplat,
            &["sparse_4/0/confidence_dsp.npy", "sparse_4/1/images.txt"],
        ),
        (mast3r, &["reconstruction/0/cameras.txt"]),
        (gaussianobject, &["dust3r_4.json", "dust3r_4.ply"]),
        (instant_ngp, &["transforms.json"]),
        (blender, &["transforms_train.json"]),
    ];
    let mut random = crate::geometry::Random::new(5);
    let (mut n_loaded, mut n_refused) = (0, 0);
    for (make, files) in fixtures {
        let folder = make(&written);
        for file in files {
            let good = std::fs::read(folder.path().join(file)).expect("a file");
            for round in 0..40 {
                let mut bytes = good.clone();
                if round % 4 == 0 {
                    bytes.truncate(random.index(bytes.len()));
                } else {
                    for _ in 0..round {
                        let at = random.index(bytes.len());
                        bytes[at] = random.index(256) as u8;
                    }
                }
                folder.write(file, bytes);
                match folder.load() {
                    Ok(_) => n_loaded += 1,
                    Err(e) => {
                        let text = e.to_string();
                        assert!(!text.contains('\n') && text.len() < 2000, "{text}");
                        n_refused += 1;
                    }
                }
            }
            folder.write(file, good);
        }
        assert!(folder.load().is_ok());
    }
    assert!(n_loaded > 5 && n_refused > 100, "{n_loaded} {n_refused}");
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_and_links_are_followed() {
    let written = still_life();
    let folder = vggt(&written);
    for file in ["sparse/images.txt", "split.json"] {
        let path = folder.path().join(file);
        let _ = std::fs::remove_file(&path);
        let made = Command::new("mkfifo").arg(&path).status().expect("mkfifo");
        assert!(made.success());
        folder.fails_with(&[file, "not a regular file"]);
        std::fs::remove_file(&path).expect("the pipe");
        write_colmap(&folder, "sparse", views(&written), "PINHOLE", pinhole);
    }
    let elsewhere = Folder::empty();
    write_images(&elsewhere, "photographs", views(&written));
    std::fs::remove_dir_all(folder.path().join("images")).expect("the images");
    let link = folder.path().join("images");
    std::os::unix::fs::symlink(elsewhere.path().join("photographs"), link).expect("a link");
    assert_eq!(folder.scene().train.len(), 4);
}
