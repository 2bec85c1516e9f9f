//! Files and names that are missing, cut off or wrong.

use super::*;

#[test]
fn missing_folders_and_files_are_named() {
    let folder = Folder::empty();
    let missing = load(&folder.path().join("nowhere"), &options());
    fails_with(
        missing,
        ErrorKind::Failure,
        &["nowhere", "no such scene folder", "give"],
    );
    folder.fails_with(&["no scene in this folder", "`sparse/0`"]);
    folder.write("sparse/0/cameras.txt", CAMERAS_TXT);
    folder.fails_with(&["sparse/0/images.txt", "cannot read"]);
    for (name, way_out) in [
        ("sparce", "did you mean `sparse`?"),
        ("garden", "`--scene builtin`"),
    ] {
        let source = SceneSource::Folder(folder.path().join(name)).resolved();
        fails_with(
            source,
            ErrorKind::Failure,
            &["cannot open the scene", name, way_out],
        );
    }
    folder.write("sparse/0/images.txt", images_txt(&["a.png"]));
    folder.fails_with(&["no point cloud"]);
    folder.write("sparse/0/points3D.ply", GOOD_PLY);
    folder.fails_with(&["images", "cannot list the images", "put the photographs"]);
    folder.write("images/other.png", png(4, 4));
    folder.fails_with(&["images", "none of the 1 posed images", "`a.png`"]);
    folder.write("images/a.png", png(SIZE.0, SIZE.1));
    assert_eq!(folder.scene().train.len(), 1);
}

#[test]
fn models_without_an_image_are_refused() {
    let mut model = good();
    model.images.clear();
    model.fails_with(
        "images.txt",
        "images.bin",
        &["no posed image", "run it again"],
    );
}

#[test]
fn image_names_that_leave_the_folder_or_are_none_are_refused() {
    for (name, what) in [
        ("../x.png", "leaves the scene"),
        ("a/../../x.png", "leaves the scene"),
        ("..\\x.png", "leaves the scene"),
        ("/etc/x.png", "leaves the scene"),
        ("\\\\server\\x.png", "leaves the scene"),
        ("C:\\x.png", "leaves the scene"),
        ("a\u{1b}[31m.png", "control characters"),
        ("", "is empty"),
    ] {
        let mut model = good();
        model.images[0].3 = name.as_bytes().to_vec();
        model.fails_with(
            "images.txt: line 2",
            "images.bin: byte 8",
            &["image name", what],
        );
    }
    let mut model = good();
    model.images[0].3 = b"caf\xe9.png".to_vec();
    model
        .folder("0", true)
        .fails_with(&["images.bin: byte 8", "`caf\\xe9.png` is not UTF-8"]);
    model
        .folder("0", false)
        .fails_with(&["images.txt: line 2", "not UTF-8"]);
}

#[test]
fn duplicate_image_names_are_refused() {
    let mut model = good();
    model.images[1].3 = b"c.png".to_vec();
    model.fails_with(
        "images.txt: line 4",
        "images.bin: byte 110",
        &["`c.png`", "appears twice"],
    );
}

#[test]
fn text_models_without_observation_lines_are_refused() {
    let folder = good().folder("sparse", false);
    let text = images_txt(&["a.png", "b.png"]).replace("\n\n", "\n");
    folder.write(
        "sparse/images.txt",
        text.replace("1 a", "4 a").replace("1 b", "4 b"),
    );
    folder.fails_with(&["images.txt: line 2", "two lines an image"]);
}

#[test]
fn every_truncation_of_a_binary_model_is_refused_with_its_byte() {
    let model = good();
    let folder = model.folder("sparse/0", true);
    for (name, bytes) in [
        ("cameras.bin", model.cameras_bin()),
        ("images.bin", model.images_bin()),
    ] {
        for end in 0..bytes.len() {
            folder.write(&format!("sparse/0/{name}"), &bytes[..end]);
            folder.fails_with(&[&format!("{name}: byte"), &format!("ends at byte {end}")]);
        }
        folder.write(&format!("sparse/0/{name}"), bytes);
    }
    check_good(&folder.scene(), &model);
}

#[test]
fn absurd_counts_in_a_binary_model_cost_nothing() {
    let model = good();
    let folder = model.folder("sparse/0", true);
    for (name, bytes) in [
        ("cameras.bin", model.cameras_bin()),
        ("images.bin", model.images_bin()),
    ] {
        for count in [1000u64, 1 << 40, u64::MAX] {
            let mut absurd = bytes.clone();
            absurd[..8].copy_from_slice(&count.to_le_bytes());
            folder.write(&format!("sparse/0/{name}"), absurd);
            folder.fails_with(&[&format!("{name}: byte 0"), &count.to_string(), "at most"]);
        }
        folder.write(&format!("sparse/0/{name}"), bytes);
    }
}
