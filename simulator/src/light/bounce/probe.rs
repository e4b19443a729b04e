#[cfg(test)]
mod tests {
    use super::super::*;
    use super::super::{cast::Caster, paths::*, optics::Optics, patches::*};
    use crate::target::Target;
    #[test]
    fn probe() {
        let target = Target::built_in("corner").unwrap();
        let scene = Scene::new(&target).unwrap();
        let surfaces = Surfaces::new(&scene);
        let bound = Bound::new(&scene, &surfaces.list);
        let sun = DVec3::new(0.7,0.3,0.6).normalize();
        let to = DVec3::new(0.62497710016701202, -0.36388204732034252, 0.69064714572984998);
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let mut optics = Optics::new(scene.materials(), &[500.0]);
        for both in [true, false] {
        let mut paths = Paths { surfaces: &surfaces, caster: &caster, optics: &mut optics, active: &bound.active, both_ends: both, seed: 4 };
        let mut s = Sums::new(1);
        paths.trace(sun, Toward::Far(to), 1<<13, &mut s);
        eprintln!("paths {both} {:?} direct {}", s.bounced(0), s.direct(0));
        }
        let b = Bounce::new(&scene, &BounceOptions { tolerance: 5e-3, seed: 1 }).unwrap();
        let Way::Still(still) = &b.way else { panic!() };
        let (mut w, mut e) = ([0.0], [0.0]);
        let mut l = StillLight::new(&scene, still.clone());
        let mut ww = vec![0.0; b.terms().len()]; let mut ee = ww.clone();
        l.add(sun, Toward::Far(to), &mut ww, &mut ee);
        eprintln!("{ww:?} {ee:?}");
        let _ = (&mut w, &mut e); eprintln!("{}", b.need().why);
        let p = Patches::new(&surfaces.list, &bound.active, 0.3);
        for c in &p.cells { let a: f64 = c.patches().map(|k| p.list[k].area).sum(); eprintln!("{} {} {}", c.surface, surfaces.list[c.surface].area, a);
          for k in c.patches() { let q = p.list[k].even(0.3,0.8); if c.at(q) != Some(k) { eprintln!("bad {k} {:?} {q:?} {:?}", p.list[k], c); } } }
    }
}
