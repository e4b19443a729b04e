//! Without the feature there is nothing to try; `./test` says so.
#![cfg(not(feature = "opencv"))]

#[test]
fn frame_grabbers_through_opencv() {
    let reason = "built without OpenCV (./test --opencv installs it and builds with it)";
    sunglint_testkit::skip("frame_grabbers_through_opencv", reason);
}
