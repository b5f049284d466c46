use host_sim::theory::*;
use splash_firmware::geometry::Mask;
fn main() {
    let beta: f64 = std::env::args().nth(1).unwrap().parse().unwrap();
    for n in std::env::args().skip(2) {
        let n: usize = n.parse().unwrap();
        let t = std::time::Instant::now();
        let th = Theory::new(&Mask::circle(n).unwrap(), default_order(n), &[Layer { weight: 1.0, beta }], Reconstruction::Mixed).unwrap();
        let t1 = t.elapsed();
        let r = th.residuals(&mut || ());
        println!("N={n} {:?} {:?}", t1, t.elapsed());
        let f = |v: &Vec<f64>| v.iter().map(|x| format!("{x:.5}")).collect::<Vec<_>>().join(" ");
        println!("splash s {}\n       t {}", f(&r.splash.sensed), f(&r.splash.total));
        println!("spl_lv s {}\n       t {}", f(&r.splash_lever.sensed), f(&r.splash_lever.total));
        println!("lgs    s {}\n       t {}", f(&r.lgs.sensed), f(&r.lgs.total));
        println!("lgs_lv s {}\n       t {}", f(&r.lgs_lever.sensed), f(&r.lgs_lever.total));
        println!("ngs    t {}", f(&r.ngs.total));
    }
}
