//! p
use opencv::{core::{Mat, Size, Vector, CV_8UC1, CV_8UC3}, imgcodecs, prelude::*, videoio};
fn four(s: &str) -> i32 { let c: Vec<char> = s.chars().collect(); videoio::VideoWriter::fourcc(c[0], c[1], c[2], c[3]).unwrap() }
fn tag(v: f64) -> String { let v = v as i64 as i32; v.to_le_bytes().iter().map(|&b| b as char).collect() }
fn show(p: &str, api: i32) {
    let r = videoio::VideoCapture::from_file(p, api);
    let mut c = match r { Ok(c) => c, Err(e) => { println!("  {p}: Err {e}"); return } };
    if !c.is_opened().unwrap() { println!("  {p}: not opened"); return }
    println!("  {p}: backend {} fourcc {:?} pixfmt {:?} count {} fps {} size {}x{} bitrate {}", c.get_backend_name().unwrap(), tag(c.get(videoio::CAP_PROP_FOURCC).unwrap()), tag(c.get(videoio::CAP_PROP_CODEC_PIXEL_FORMAT).unwrap()), c.get(videoio::CAP_PROP_FRAME_COUNT).unwrap(), c.get(videoio::CAP_PROP_FPS).unwrap(), c.get(3).unwrap(), c.get(4).unwrap(), c.get(videoio::CAP_PROP_BITRATE).unwrap());
    let mut n = 0; let mut m = Mat::default(); let mut ms = vec![]; let mut first = vec![];
    while c.grab().unwrap() { let ok = c.retrieve_def(&mut m).unwrap(); if !ok { println!("   retrieve false at {n}"); } ms.push(c.get(0).unwrap()); if n == 0 && ok { first = m.data_bytes().unwrap().to_vec(); println!("   typ {} {}x{}", m.typ(), m.cols(), m.rows()); } n += 1; }
    println!("   {n} frames, ms {:?}.. ; first bytes {:?}", &ms[..ms.len().min(4)], &first[..first.len().min(12)]);
    if first.len() == 65536 * 3 { let bad = first.chunks(3).enumerate().filter(|(i, c)| c.iter().any(|&v| v as usize != i % 256)).count(); println!("   gray ramp pixels wrong: {bad}"); }
}
fn main() {
    let d = std::env::temp_dir().join("ocvp"); let _ = std::fs::create_dir_all(&d); let p = |n: &str| d.join(n).to_string_lossy().into_owned();
    println!("{}", opencv::core::get_version_string().unwrap());
    let ramp: Vec<u8> = (0..65536).map(|i| (i % 256) as u8).collect();
    for (cc, ext) in [("FFV1", "avi"), ("FFV1", "mkv"), ("MJPG", "avi"), ("MPNG", "avi"), ("HFYU", "avi"), ("Y800", "avi"), ("I420", "avi"), ("GREY", "avi")] { for color in [false, true] {
        let f = p(&format!("{cc}_{color}.{ext}"));
        let mut w = videoio::VideoWriter::new(&f, four(cc), 10.0, Size::new(256, 256), color).unwrap();
        println!("{f} opened {}", w.is_opened().unwrap());
        if !w.is_opened().unwrap() { continue }
        for _ in 0..20 { if color { let v: Vec<opencv::core::Vec3b> = ramp.iter().map(|&r| opencv::core::Vec3b::from([r, r, r])).collect(); w.write(&Mat::new_rows_cols_with_data(256, 256, &v).unwrap()).unwrap(); } else { w.write(&Mat::new_rows_cols_with_data(256, 256, &ramp).unwrap()).unwrap(); } }
        w.release().unwrap();
        println!("  {} bytes", std::fs::metadata(&f).unwrap().len());
        show(&f, videoio::CAP_FFMPEG);
    } }
    let b = std::fs::read(p("FFV1_false.avi")).unwrap();
    for cut in [b.len() / 2, b.len() - 100, 3000, 5700, 100, 0] { let f = p(&format!("cut{cut}.avi")); std::fs::write(&f, &b[..cut]).unwrap(); println!("cut {cut} of {}", b.len()); show(&f, videoio::CAP_FFMPEG); }
    let f = p("zero.avi"); let mut w = videoio::VideoWriter::new(&f, four("FFV1"), 10.0, Size::new(256, 256), false).unwrap(); w.release().unwrap(); println!("zero: {:?}", std::fs::metadata(&f).map(|m| m.len())); show(&f, videoio::CAP_FFMPEG);
    show(&p("absent.avi"), videoio::CAP_FFMPEG);
    let mut bad = b.clone(); for i in 0..200 { bad[b.len() / 2 + i] ^= 0xff; } std::fs::write(p("bad.avi"), &bad).unwrap(); println!("flipped"); show(&p("bad.avi"), videoio::CAP_FFMPEG);
    let px: Vec<u16> = (0..65536).map(|i| i as u16).collect();
    for i in [0, 1, 2, 4] { imgcodecs::imwrite(&p(&format!("g_{i:03}.png")), &Mat::new_rows_cols_with_data(256, 256, &px).unwrap(), &Vector::new()).unwrap(); }
    imgcodecs::imwrite(&p("one_000.png"), &Mat::new_rows_cols_with_data(256, 256, &px).unwrap(), &Vector::new()).unwrap();
    for n in ["g_%03d.png", "one_%03d.png"] { for api in [videoio::CAP_IMAGES, videoio::CAP_ANY] { println!("api {api}"); show(&p(n), api); } }
    println!("live {:?}", videoio::VideoCapture::new(0, videoio::CAP_V4L2).and_then(|c| c.is_opened()));
    println!("live path {:?}", videoio::VideoCapture::from_file("/dev/video0", videoio::CAP_V4L2).and_then(|c| c.is_opened()));
    let _ = (CV_8UC1, CV_8UC3);
}
