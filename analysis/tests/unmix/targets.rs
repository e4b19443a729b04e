//! Confusion and signatures in cases that can be done by hand.

use ndarray::array;
use sunglint_analysis::unmix::{AtgpOptions, Confusion, atgp, spectral_angle_rad};

/// Truth: done by hand. A sample of materials (0.5, 0.5) taken for (0.8, 0.2): 0.5 and 0.2 agree, the 0.3 that is missing of the second went to the first.
#[test]
fn a_confusion_is_that_done_by_hand() {
    let c = Confusion::of(
        array![[0.5, 0.5], [0.0, 1.0], [f64::NAN, 1.0]].view(),
        array![[0.8, 0.2], [0.25, 0.75], [0.5, 0.5]].view(),
    )
    .unwrap();
    assert_eq!((c.samples, c.left_out), (2, 1));
    assert!((c.matrix[(0, 0)] - 1.0).abs() < 1e-15 && c.matrix[(0, 1)] == 0.0);
    assert!((c.matrix[(1, 1)] - 0.95 / 1.5).abs() < 1e-15, "{}", c.matrix);
    assert!((c.matrix[(1, 0)] - 0.55 / 1.5).abs() < 1e-15);
    assert!(Confusion::of(array![[1.0]].view(), array![[-0.1]].view()).is_err());
    assert!(Confusion::of(array![[1.0, 0.0]].view(), array![[1.0]].view()).is_err());
    // A material without light has no row.
    let c = Confusion::of(array![[1.0, 0.0]].view(), array![[0.9, 0.1]].view()).unwrap();
    assert!(c.matrix[(1, 1)].is_nan() && (c.worst() - 0.9).abs() < 1e-15);
}

/// Truth: mixtures of two signatures with known corners: the corners are the longest sample and the one furthest from it; the third rest is rounding. η after the second is 1 less the squared
/// cosine of their angle.
#[test]
fn the_corners_of_a_mixture_are_its_signatures() {
    let (a, b) = ([3.0, 1.0, 0.5, 0.1], [0.2, 0.4, 1.0, 1.5]);
    let mix = |t: f64| (0..4).map(|i| (1.0 - t) * a[i] + t * b[i]).collect::<Vec<f64>>();
    let rows: Vec<f64> = (0..=10).flat_map(|k| mix(f64::from(k) / 10.0)).collect();
    let samples = ndarray::Array2::from_shape_vec((11, 4), rows).unwrap();
    let found = atgp(samples.view(), &AtgpOptions::default()).unwrap();
    let places: Vec<_> = found.targets.iter().map(|t| t.sample).collect();
    assert_eq!(places, [Some(0), Some(10)]);
    let (aa, bb) = (a.map(|v| v * v).iter().sum::<f64>(), b.map(|v| v * v).iter().sum::<f64>());
    let ab: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    assert!((found.targets[1].eta - (1.0 - ab * ab / (aa * bb))).abs() < 1e-14);
    assert!((spectral_angle_rad(&a, &b) - (ab / (aa * bb).sqrt()).acos()).abs() < 1e-14);
    assert!(found.left < 1e-12 && found.stopped.contains("noise"));

    let refused = |samples: ndarray::Array2<f64>| {
        atgp(samples.view(), &AtgpOptions::default()).unwrap_err().to_string()
    };
    assert!(refused(ndarray::Array2::zeros((3, 4))).contains("without any light"));
    assert!(refused(array![[1.0, f64::NAN]]).contains("band 2"));
    // A given beginning is kept, and one that is wrong refused.
    let options = AtgpOptions { first: Some(b.to_vec()), ..AtgpOptions::default() };
    let found = atgp(samples.view(), &options).unwrap();
    assert_eq!(found.targets.iter().map(|t| t.sample).collect::<Vec<_>>(), [None, Some(0)]);
    let options = AtgpOptions { first: Some(vec![1.0]), ..AtgpOptions::default() };
    assert!(atgp(samples.view(), &options).is_err());
}
