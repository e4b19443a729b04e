//! Places that the virtual telescope goes to, corrected by where its frames look.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::{DVec2, DVec3};
use hifitime::{Epoch, Unit};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{
    Device, DeviceError, Identity, Mount, MountAbilities, MountAxes, MountKnown, MountPlace,
    MountReading, MountSite, MountTime, Setting,
};
use sunglint_formats::time::parse_utc;
use sunglint_observatory::telescope::{
    Danger, Goto, GotoError, GotoOptions, GotoTarget, Guard, Light, Lights, Looks, PointingModel,
    SearchOptions, SunCone, TrackError, fit_pointing,
};
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Geodetic, Observer, Site, Star,
};
use sunglint_testkit::Campaign;
use sunglint_virtual::telescope::{Telescope, TelescopeOptions, VirtualMount};

/// Turn of the camera, deg.
const CAMERA_DEG: f64 = 25.0;

fn site() -> Site {
    Site::new(Geodetic { latitude_deg: 48.78, longitude_deg: 9.18, height_m: 400.0 }).unwrap()
}

fn enu_of(star: &Star, utc: Epoch) -> DVec3 {
    let observer = Observer::at(utc, &site(), EarthOrientation::embedded()).unwrap();
    observer.star(star).horizontal.east_north_up()
}

/// Right ascension and declination (ICRS, deg) that stand in a direction: by Newton's steps on the way from places to directions.
fn sky_at(enu: DVec3, utc: Epoch) -> [f64; 2] {
    let mut sky = [0.0, 45.0];
    let at = |sky: [f64; 2]| {
        let place = Equatorial { ra_deg: sky[0].rem_euclid(360.0), dec_deg: sky[1] };
        enu_of(&Star::at("here", place).unwrap(), utc)
    };
    // From the best of a grid.
    let mut best = f64::INFINITY;
    for ra in 0..36 {
        for dec in -2..9 {
            let tried = [10.0 * f64::from(ra), 10.0 * f64::from(dec)];
            let off = at(tried).angle_between(enu);
            if off < best {
                (best, sky) = (off, tried);
            }
        }
    }
    for _ in 0..12 {
        let here = at(sky);
        let step = 1e-4;
        let by_ra = (at([sky[0] + step, sky[1]]) - here) / step;
        let by_dec = (at([sky[0], sky[1] + step]) - here) / step;
        let left = enu - here;
        sky[0] += left.dot(by_ra) / by_ra.length_squared();
        sky[1] = (sky[1] + left.dot(by_dec) / by_dec.length_squared()).clamp(-89.0, 89.0);
    }
    [sky[0].rem_euclid(360.0), sky[1]]
}

struct Stage {
    clock: DeviceClock,
    hand: Arc<VirtualClock>,
    telescope: Telescope,
}

fn stage(axes: MountAxes, star: &Star) -> Stage {
    let hand = Arc::new(VirtualClock::new());
    let start = parse_utc("2026-10-27T20:00:00Z").unwrap();
    let clock = DeviceClock { clock: hand.clone(), zero_utc: Some(start) };
    let options = TelescopeOptions::default().with(|o| {
        o.axes = axes;
        o.site_deg = [48.78, 9.18];
        o.tilt_arcsec = 1800.0;
        o.frame_s = 0.5;
    });
    let star = star.clone();
    let sky = Arc::new(move |utc: Epoch| Some(enu_of(&star, utc)));
    let telescope = Telescope::new(options, clock.clone(), sky).with_history();
    Stage { telescope, clock, hand }
}

fn options() -> GotoOptions {
    let mut options = GotoOptions::default();
    (options.refraction, options.track.watch_clock) = (false, false);
    options
}

/// Distance of the tube from the star, arcsec.
fn off(stage: &Stage) -> f64 {
    // The tube's present place.
    let _ = stage.telescope.mount().reading(&Deadline::within(Duration::from_secs(1)));
    stage.telescope.truth().last().unwrap().off_arcsec
}

/// Frames that look where the tube does.
fn looking(stage: &Stage) -> impl FnMut(&Cancel) -> Result<Looks, String> + use<> {
    let (hand, telescope, clock) =
        (stage.hand.clone(), stage.telescope.clone(), stage.clock.clone());
    move |_: &Cancel| {
        // An exposure.
        hand.sleep(Duration::from_secs(1));
        telescope.advance();
        let row = *telescope.truth().last().unwrap();
        let middle = clock.zero_utc.unwrap() + row.time_s * Unit::Second;
        let sky_deg = sky_at(row.pointing, middle);
        // The tube's upwards, turned by a camera that hangs askew: seen from north through east.
        let axes = telescope.axes_at(row.time_s).unwrap();
        let (sin, cos) = CAMERA_DEG.to_radians().sin_cos();
        let up = axes.y_axis * cos - axes.x_axis * sin;
        let [ra, dec] = sky_deg;
        let above = sky_at((row.pointing + 1e-3 * up).normalize(), middle);
        let east = (above[0] - ra + 180.0).rem_euclid(360.0) - 180.0;
        let up_deg = (east * dec.to_radians().cos()).atan2(above[1] - dec).to_degrees();
        Ok(Looks { middle, sky_deg: sky_deg.into(), up_deg, is_mirrored: false, scale_arcsec: 1.5 })
    }
}

/// Truth: the virtual telescope's own axis (whose pole is 30′ off: the mount turns directions, and knows no terms) against places of stars. Ten stars all over the sky make a model; five others are then found without a frame, within 35″ (30″ by its own
/// reading is where a mount is left, and the model is good to 5″) where the mount alone is half a degree off. A model of a mount with other axes is refused.
#[test]
fn a_model_of_its_pointing_finds_stars_without_frames() {
    let names = ["Deneb", "Vega", "Altair", "Alderamin", "Schedar", "Mirach", "Enif", "Rasalhague"];
    let more = ["Errai", "Eltanin", "Caph", "Scheat", "Alpheratz", "Sadr", "Kochab"];
    for axes in [MountAxes::Equatorial, MountAxes::Horizontal] {
        let guard = Guard::new(&site(), axes, false, SunCone::default());
        let go = |stage: &Stage, star: &Star, model: Option<&PointingModel>| {
            let mut mount = stage.telescope.mount();
            let mut look = looking(stage);
            let mut options = options();
            options.tolerance_arcsec = f64::INFINITY;
            let mut goto = Goto {
                site: &site(),
                guard: &guard,
                model,
                mount: &mut mount,
                clock: stage.clock.clone(),
                options,
                beat: &|| (),
            };
            let look: Option<&mut sunglint_observatory::telescope::Look<'_>> =
                if model.is_none() { Some(&mut look) } else { None };
            let target = GotoTarget::Star(Box::new(star.clone()));
            goto.to(&target, look, &Cancel::new(), &mut |_| ControlFlow::Continue(()))
        };
        let catalogue = Catalogue::embedded();
        let mut places = Vec::new();
        for name in names.iter().chain(&more[..2]) {
            let star = catalogue.find(name).unwrap();
            places.push(go(&stage(axes, star), star, None).unwrap().place.unwrap());
        }
        let fit = fit_pointing(axes, 48.78, &places).unwrap();
        println!("{axes:?}: {:.0}″ before, {:.1}″ after", fit.before_arcsec, fit.model.rms_arcsec);
        assert!(fit.before_arcsec > 1000.0 && fit.model.rms_arcsec < 5.0, "{fit:?}");
        for name in &more[2..] {
            let star = catalogue.find(name).unwrap();
            let there = stage(axes, star);
            go(&there, star, Some(&fit.model)).unwrap();
            let left = off(&there);
            println!("{axes:?} {name}: {left:.1}″");
            assert!(left < 35.0, "{axes:?} {name}: {left}");
        }
        let other = match axes {
            MountAxes::Equatorial => MountAxes::Horizontal,
            MountAxes::Horizontal => MountAxes::Equatorial,
        };
        let star = catalogue.find("Deneb").unwrap();
        // The Sun is kept off by what the mount shows.
        let mut far = fit.model.clone();
        far.terms_arcsec[1].1.value += 5.0 * 3600.0;
        let error = go(&stage(axes, star), star, Some(&far)).unwrap_err();
        assert!(error.to_string().contains("sync it"), "{error}");
        let wrong = PointingModel { axes: other, ..fit.model };
        let error = go(&stage(axes, star), star, Some(&wrong)).unwrap_err();
        assert!(error.to_string().contains("measure it anew"), "{error}");
    }
}

/// Truth: the virtual telescope's own axis against the star's place, with a mount whose pole is 30′ off: by its own reckoning it is minutes of arc beside the star, corrected by frames (which look where
/// the tube does) within the 30″ that were asked for, and 5″ for the star's way in the second since.
#[test]
fn a_mount_that_is_set_up_badly_finds_the_star() {
    let star = Catalogue::embedded().find("Deneb").unwrap();
    let target = GotoTarget::Star(Box::new(star.clone()));
    for axes in [MountAxes::Equatorial, MountAxes::Horizontal] {
        let guard = Guard::new(&site(), axes, false, SunCone::default());
        let go = |stage: &Stage, looks: bool| {
            let mut mount = stage.telescope.mount();
            let mut look = looking(stage);
            let mut goto = Goto {
                site: &site(),
                guard: &guard,
                model: None,
                mount: &mut mount,
                clock: stage.clock.clone(),
                options: options(),
                beat: &|| (),
            };
            let look: Option<&mut sunglint_observatory::telescope::Look<'_>> =
                if looks { Some(&mut look) } else { None };
            goto.to(&target, look, &Cancel::new(), &mut |_| ControlFlow::Continue(())).unwrap()
        };

        let alone = stage(axes, star);
        let gone = go(&alone, false);
        assert!(gone.off_arcsec.is_empty() && gone.camera.is_none());
        let own = off(&alone);
        assert!(own > 120.0, "{axes:?}: {own}");
        // It does not know that.
        assert!(gone.own_arcsec < 31.0, "{axes:?}: {}", gone.own_arcsec);
        let seeing = stage(axes, star);
        let gone = go(&seeing, true);
        let (offs, camera) = (gone.off_arcsec, gone.camera.unwrap());
        println!("{axes:?}: {own:.0}″ by itself, frames {offs:.0?}″");
        assert!(offs.len() >= 2 && offs[0] > 120.0 && *offs.last().unwrap() <= 30.0, "{offs:?}");
        let left = off(&seeing);
        assert!(left < 35.0, "{axes:?}: {left}");
        // The pole's 30′ turn the frame by 0.5° over the cosine of the declination (45°) at most.
        let turn = camera.camera_angle_deg - CAMERA_DEG;
        println!("{axes:?}: the camera's turn is {turn:.2}° off");
        assert!(turn.abs() < 1.0, "{axes:?}: {camera:?}");
        assert_eq!((camera.camera_mirrored, camera.pixel_scale_arcsec), (false, 1.5));
    }
}

/// Truth: in words. Frames that look elsewhere than any error of pointing explains, corrections that do not help, frames that tell nothing, a star near the Sun.
#[test]
fn what_does_not_arrive_says_why() {
    let star = Catalogue::embedded().find("Deneb").unwrap();
    let guard = Guard::new(&site(), MountAxes::Equatorial, false, SunCone::default());
    let go = |look: &mut sunglint_observatory::telescope::Look<'_>, star: &Star| {
        let stage = stage(MountAxes::Equatorial, star);
        let mut mount = stage.telescope.mount();
        let mut goto = Goto {
            site: &site(),
            guard: &guard,
            model: None,
            mount: &mut mount,
            clock: stage.clock.clone(),
            options: options(),
            beat: &|| (),
        };
        let target = GotoTarget::Star(Box::new(star.clone()));
        goto.to(&target, Some(look), &Cancel::new(), &mut |_| ControlFlow::Continue(()))
    };
    let now = parse_utc("2026-10-27T20:00:30Z").unwrap();
    let place = star.icrs;
    let looks = |by_deg: f64| {
        let sky_deg = [place.ra_deg, place.dec_deg - by_deg];
        move |_: &Cancel| {
            let (up_deg, is_mirrored, scale_arcsec) = (0.0, false, 1.0);
            Ok(Looks { middle: now, sky_deg: sky_deg.into(), up_deg, is_mirrored, scale_arcsec })
        }
    };
    let lost = go(&mut looks(20.0), star).unwrap_err();
    assert!(matches!(lost, GotoError::Lost { off_deg } if (off_deg - 20.0).abs() < 0.1), "{lost}");
    let short = go(&mut looks(0.05), star).unwrap_err();
    assert!(
        matches!(short, GotoError::Short { rounds: 5, off_arcsec, .. } if (off_arcsec - 180.0).abs() < 5.0),
        "{short}"
    );
    let blind = go(&mut |_| Err("no stars".into()), star).unwrap_err();
    assert!(blind.to_string().contains("no stars"), "{blind}");
    // Within the Sun's cone by day: Spica stands 2° from the Sun in the middle of October.
    let spica = Catalogue::embedded().find("Spica").unwrap();
    let hand = Arc::new(VirtualClock::new());
    let clock =
        DeviceClock { clock: hand, zero_utc: Some(parse_utc("2026-10-17T10:00:00Z").unwrap()) };
    let telescope = Telescope::new(TelescopeOptions::default(), clock.clone(), Arc::new(|_| None));
    let mut mount = telescope.mount();
    let axes = mount.abilities().axes;
    let guard = Guard::new(&site(), axes, false, SunCone::default());
    let mut goto = Goto {
        site: &site(),
        guard: &guard,
        model: None,
        mount: &mut mount,
        clock,
        options: options(),
        beat: &|| (),
    };
    let target = GotoTarget::Star(Box::new(spica.clone()));
    let error = goto.to(&target, None, &Cancel::new(), &mut |_| ControlFlow::Continue(()));
    assert!(
        matches!(error, Err(GotoError::Track(TrackError::Danger(Danger::Sun { .. })))),
        "{error:?}"
    );
}

/// A mount that stops so far beside each place that it is sent to, deg of right ascension and declination, and counts how often it is sent. One that does not know it shows the place that it was sent to, until it
/// is told where it is.
struct Beside {
    mount: VirtualMount,
    by_deg: [f64; 2],
    knows: bool,
    sent: usize,
    /// A hand that stops it after the next reading, and the clock that goes on until it stands.
    hand: Option<(Arc<AtomicBool>, Arc<VirtualClock>)>,
}

impl Device for Beside {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.mount.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        self.mount.settings(deadline)
    }
}

impl Mount for Beside {
    fn abilities(&self) -> &MountAbilities {
        self.mount.abilities()
    }

    fn know(&mut self, known: &MountKnown) {
        self.mount.know(known);
    }

    fn reading(&mut self, deadline: &Deadline) -> Result<MountReading, DeviceError> {
        let mut reading = self.mount.reading(deadline)?;
        if let (MountPlace::Equatorial { ra_deg, dec_deg }, false) =
            (&mut reading.place, self.knows)
        {
            *ra_deg = (*ra_deg + self.by_deg[0]).rem_euclid(360.0);
            *dec_deg += self.by_deg[1];
        }
        if let Some((stops, clock)) = &self.hand
            && stops.swap(false, Ordering::Relaxed)
        {
            self.mount.stop(deadline)?;
            clock.sleep(Duration::from_secs(1));
        }
        Ok(reading)
    }

    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.sent += 1;
        let place = match place {
            MountPlace::Equatorial { ra_deg, dec_deg } => MountPlace::Equatorial {
                ra_deg: (ra_deg - self.by_deg[0]).rem_euclid(360.0),
                dec_deg: dec_deg - self.by_deg[1],
            },
            other => other,
        };
        self.mount.begin_goto(place, deadline)
    }

    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        let MountPlace::Equatorial { ra_deg, dec_deg } = place else {
            return self.mount.sync(place, deadline);
        };
        let stands = self.mount.reading(deadline)?.place;
        if let MountPlace::Equatorial { ra_deg: own_ra, dec_deg: own_dec } = stands {
            let east = (ra_deg - own_ra + 180.0).rem_euclid(360.0) - 180.0;
            self.by_deg = [east, dec_deg - own_dec];
        }
        Ok(())
    }

    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.mount.set_tracking(on, deadline)
    }

    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError> {
        self.mount.learn_senses(beat, deadline)
    }

    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        self.mount.set_rates(deg_s, deadline)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.mount.stop(deadline)
    }

    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.mount.set_parked(parked, deadline)
    }

    fn site(&mut self, deadline: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        self.mount.site(deadline)
    }

    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        self.mount.time(deadline)
    }

    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.mount.set_site(site, utc, deadline)
    }
}

/// Truth: the virtual telescope's own axis against the star. Its motors go to the hour angle that the star has in the beginning: at 0.5 °/s the way to Deneb (45° of declination) takes a minute and a half, in which the
/// sky turns by 20′. Sent again it is on the star within 30″ and its errors (10″ of backlash, 2″ of the worm, the wind). One that stops 5′ beside each place is sent four times in all, and those 5′ are told.
#[test]
fn a_mount_that_is_late_is_sent_again() {
    let star = Catalogue::embedded().find("Deneb").unwrap();
    let guard = Guard::new(&site(), MountAxes::Equatorial, false, SunCone::default());
    let go = |by_deg: f64| {
        let hand = Arc::new(VirtualClock::new());
        let start = parse_utc("2026-10-27T20:00:00Z").unwrap();
        let clock = DeviceClock { clock: hand, zero_utc: Some(start) };
        let makings = TelescopeOptions::default().with(|o| {
            o.axes = MountAxes::Equatorial;
            o.site_deg = [48.78, 9.18];
            (o.tilt_arcsec, o.fastest_deg_s, o.frame_s) = (0.0, 0.5, 0.5);
        });
        let (own, target) = (star.clone(), GotoTarget::Star(Box::new(star.clone())));
        let sky = Arc::new(move |utc: Epoch| Some(enu_of(&own, utc)));
        let telescope = Telescope::new(makings, clock.clone(), sky);
        let mut mount = Beside {
            mount: telescope.mount(),
            by_deg: [0.0, by_deg],
            knows: true,
            sent: 0,
            hand: None,
        };
        let mut goto = Goto {
            site: &site(),
            guard: &guard,
            model: None,
            mount: &mut mount,
            clock: clock.clone(),
            options: options(),
            beat: &|| (),
        };
        let each = &mut |_: &_| ControlFlow::Continue(());
        let gone = goto.to(&target, None, &Cancel::new(), each).unwrap();
        clock.clock.sleep(Duration::from_secs(1));
        telescope.advance();
        let off = telescope.truth().last().unwrap().off_arcsec;
        println!("{by_deg}: {off:.1}″, says {:.1}″, sent {}", gone.own_arcsec, mount.sent);
        (off, gone.own_arcsec, mount.sent)
    };
    let (off, own, sent) = go(0.0);
    assert!(off < 45.0 && own <= 30.0 && (2..=4).contains(&sent), "{off} {own} {sent}");
    let (off, own, sent) = go(1.0 / 12.0);
    assert!((off - 300.0).abs() < 45.0 && (own - 300.0).abs() < 45.0 && sent == 4, "{off} {own}");
}

/// Numbers in [0, 1): splitmix64.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The thesis' camera: 10′ × 8′, 0.6″ a pixel.
const SIDES_PX: [f64; 2] = [1000.0, 800.0];
const SCALE_ARCSEC: f64 = 0.6;
/// Flux of the star in its frames; the stars about it are a thirtieth of it.
const FLUX: f64 = 30_000.0;

/// How a start went.
#[derive(Debug)]
struct Start {
    /// Time that it took, s.
    took_s: f64,
    /// Distance of the tube from the star in the end, arcsec.
    off_arcsec: f64,
    /// Error of the camera's turn that was found, deg.
    turn_deg: f64,
    /// Distance of the tube from another star that the mount goes to afterwards by itself, arcsec.
    next_arcsec: f64,
}

/// A start with a camera that nobody has measured, on a mount that is off by up to half a degree.
fn start(seed: u64, least_flux: Option<f64>, knows_turn: bool) -> Result<Start, GotoError> {
    start_with(seed, least_flux, knows_turn, None)
}

/// The same, with a hand that stops the mount after a frame of this number.
fn start_with(
    seed: u64,
    least_flux: Option<f64>,
    knows_turn: bool,
    stops_after: Option<usize>,
) -> Result<Start, GotoError> {
    let mut dice = Dice(seed * 104_729 + 7);
    let names = ["Deneb", "Vega", "Altair", "Alderamin", "Schedar", "Mirach"];
    let name = names[(dice.next() * names.len() as f64) as usize % names.len()];
    let star = Catalogue::embedded().find(name).unwrap().clone();
    let hand = Arc::new(VirtualClock::new());
    let begin = parse_utc("2026-10-27T20:00:00Z").unwrap();
    let clock = DeviceClock { clock: hand.clone(), zero_utc: Some(begin) };
    let makings = TelescopeOptions::default().with(|o| {
        (o.axes, o.seed, o.frame_s) = (MountAxes::Equatorial, seed, 0.5);
        o.site_deg = [48.78, 9.18];
    });
    let own = star.clone();
    let sky = Arc::new(move |utc: Epoch| Some(enu_of(&own, utc)));
    let telescope = Telescope::new(makings, clock.clone(), sky).with_history();
    // Anywhere in a circle of half a degree.
    let (far, towards) = (0.5 * dice.next().sqrt(), std::f64::consts::TAU * dice.next());
    let across = star.icrs.dec_deg.to_radians().cos();
    let by_deg = [far * towards.cos() / across, far * towards.sin()];
    let hand_stops = Arc::new(AtomicBool::new(false));
    let mut mount = Beside {
        mount: telescope.mount(),
        by_deg,
        knows: false,
        sent: 0,
        hand: Some((hand_stops.clone(), hand.clone())),
    };
    let (camera_deg, is_mirrored) = (360.0 * dice.next() - 180.0, dice.next() < 0.5);
    let dice_turn = dice.next();
    // A star of a thirtieth of the light somewhere in each frame.
    let faint = move |dice: &mut Dice| Light {
        place_px: DVec2::new((dice.next() - 0.5) * SIDES_PX[0], (dice.next() - 0.5) * SIDES_PX[1]),
        flux: FLUX / 30.0,
    };
    let (seen, seen_clock, target) = (telescope.clone(), clock.clone(), star.clone());
    let mut frames = 0;
    let mut glance = |_: &Cancel| {
        frames += 1;
        // The reading that ends this frame still shows it tracking.
        hand_stops.store(stops_after == Some(frames), Ordering::Relaxed);
        // Exposure and reading out.
        hand.sleep(Duration::from_millis(300));
        seen.advance();
        let time_s = (seen_clock.utc() - begin).to_seconds() - 0.2;
        let middle = begin + time_s * Unit::Second;
        let axes = seen.axes_at(time_s).unwrap();
        let light = enu_of(&target, middle);
        // Gnomonic, on the tube's own axes; the camera hangs askew, and may look by a mirror.
        let depth = light.dot(axes.z_axis);
        let place = DVec2::new(light.dot(axes.x_axis), light.dot(axes.y_axis)) / depth;
        let place = place * (206_264.806 / SCALE_ARCSEC);
        let turned = DVec2::from_angle(-camera_deg.to_radians()).rotate(place);
        let turned = if is_mirrored { DVec2::new(-turned.x, turned.y) } else { turned };
        let noise = DVec2::new(dice.next() - 0.5, dice.next() - 0.5);
        let mut lights = vec![faint(&mut dice)];
        if depth > 0.0 && turned.x.abs() < 0.5 * SIDES_PX[0] && turned.y.abs() < 0.5 * SIDES_PX[1] {
            lights.push(Light { place_px: turned + noise, flux: FLUX * (0.9 + 0.2 * dice.next()) });
        }
        Ok(Lights { middle, size_px: SIDES_PX.into(), lights })
    };
    let guard = Guard::new(&site(), MountAxes::Equatorial, false, SunCone::default());
    let mut options = options();
    (options.tolerance_arcsec, options.rounds, options.sync) = (4.0, 8, true);
    let mut search = SearchOptions::new(SCALE_ARCSEC);
    search.least_flux = least_flux;
    // Within two degrees.
    search.camera_angle_deg = knows_turn.then_some(camera_deg + 4.0 * (dice_turn - 0.5));
    let mut goto = Goto {
        site: &site(),
        guard: &guard,
        model: None,
        mount: &mut mount,
        clock: clock.clone(),
        options,
        beat: &|| (),
    };
    let each = &mut |_: &_| ControlFlow::Continue(());
    let target = GotoTarget::Star(Box::new(star.clone()));
    let gone = goto.search(&target, &mut glance, &search, &Cancel::new(), each)?;
    let took_s = (clock.utc() - begin).to_seconds();
    let off = |star: &Star| {
        telescope.advance();
        let time_s = (clock.utc() - begin).to_seconds();
        let ahead = telescope.axes_at(time_s).unwrap().z_axis;
        ahead.angle_between(enu_of(star, clock.utc())).to_degrees() * 3600.0
    };
    let off_arcsec = off(&star);
    let camera = gone.camera.unwrap();
    assert_eq!(camera.camera_mirrored, is_mirrored, "{seed}");
    let turn_deg = (camera.camera_angle_deg - camera_deg + 540.0).rem_euclid(360.0) - 180.0;
    let scale = camera.pixel_scale_arcsec / SCALE_ARCSEC;
    assert!((0.8..1.25).contains(&scale), "{seed}: {camera:?}");
    // Sadr stands 6° to 45° from these stars.
    let next = Catalogue::embedded().find("Sadr").unwrap().clone();
    let target = GotoTarget::Star(Box::new(next.clone()));
    goto.options.sync = false;
    goto.to(&target, None, &Cancel::new(), each)?;
    Ok(Start { took_s, off_arcsec, turn_deg, next_arcsec: off(&next) })
}

/// Truth: the virtual telescope's own axis against the star, and its clock. A field of 10′ × 8′ whose turn is known within 2° and whose mirror nobody knows, a mount that is off by anything within half a degree and does not know it. Tolerance:
/// the issue's, the star within 5″ of the frame's middle in two minutes in 95 of 100 starts. The camera's turn comes from two moves of 72″ with 10″ of backlash: 15° at most.
/// Told where it is, the mount then finds another star by itself, within its tilt of 60″, backlash and the 30″ by its own reading at which it is left.
#[test]
fn campaign_thesis_starts() {
    let mut campaign = Campaign::start("thesis_starts", 200);
    let seeds = campaign.seeds();
    let run = |least_flux: Option<f64>, knows_turn: bool| -> Vec<Start> {
        let starts = seeds.clone().into_par_iter();
        let run =
            |seed| start(seed, least_flux, knows_turn).inspect_err(|e| println!("{seed}: {e}"));
        starts.filter_map(|seed| run(seed).ok()).collect()
    };
    let starts = run(Some(0.25 * FLUX), true);
    let sorted = |of: fn(&Start) -> f64, starts: &[Start]| {
        let mut values: Vec<f64> = starts.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        [0.5, 0.95, 1.0].map(|part| values[((values.len() - 1) as f64 * part).round() as usize])
    };
    let took = sorted(|start| start.took_s, &starts);
    let off = sorted(|start| start.off_arcsec, &starts);
    let turn = sorted(|start| start.turn_deg.abs(), &starts);
    let next = sorted(|start| start.next_arcsec, &starts);
    println!("median, 95 %, most: {took:.0?} s, {off:.1?}″, turn {turn:.1?}°, next {next:.0?}″");
    let good = starts.iter().filter(|start| start.took_s <= 120.0 && start.off_arcsec <= 5.0);
    let good = good.count();
    let all = seeds.clone().count();
    println!("{good} of {all} within 5″ in two minutes, {} in the end", starts.len());
    assert!(good * 100 >= all * 95, "{good} of {all}");
    assert!(turn[2] < 15.0 && next[2] < 150.0, "{turn:?} {next:?}");
    campaign.largest("longest_s", took[2]);
    campaign.largest("farthest_arcsec", off[2]);
    if campaign.is_whole() {
        campaign.largest("took_median_s", took[0]);
        campaign.largest("took_95_s", took[1]);
        campaign.largest("off_95_arcsec", off[1]);
        campaign.largest("missed", (all - good) as f64);
        for (name, figure, least_flux, knows_turn) in [
            ("turn not known", "unknown_turn_95_s", Some(0.25 * FLUX), false),
            ("all fields", "all_fields_95_s", None, true),
        ] {
            let took = sorted(|start| start.took_s, &run(least_flux, knows_turn));
            println!("{name}: median, 95 %, most: {took:.0?} s");
            campaign.largest(figure, took[1]);
        }
    }
    campaign.finish();
}

/// Truth: in words. A light that is too faint to be the star is not taken for it, and the message says how far was looked and what was seen.
#[test]
fn a_star_that_is_not_there_is_not_found() {
    let error = start(3, Some(10.0 * FLUX), true).unwrap_err();
    assert!(matches!(error, GotoError::Unseen { flux: Some(flux), .. } if flux < 1.2 * FLUX));
    assert!(error.to_string().contains("fields up to 0.50°"), "{error}");
}

/// Truth: in words. Who stops the mount between two frames of a search has the last word: it is not sent on. The stop comes after the reading that ends the third frame, which still shows it tracking.
#[test]
fn a_hand_that_stops_the_mount_ends_a_search() {
    let error = start_with(3, Some(10.0 * FLUX), true, Some(3)).unwrap_err();
    assert!(matches!(error, GotoError::Track(TrackError::ByHand { .. })), "{error}");
}
