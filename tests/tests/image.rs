//! The configuration image: what is loaded is what was saved, and nothing else is loaded.

use splash_firmware::config::Config;
use splash_firmware::error::Field;
use splash_firmware::gate::ShortFrame;
use splash_firmware::image::ImageError;
use splash_firmware::mirror::Serials;
use splash_firmware::pipeline::Pipeline;
use splash_firmware::pixels::Convention;
use splash_firmware::spec::Estimator;
use splash_tests::frames::{Background, Rng, frame, scattered};
use splash_tests::instrument::{Instrument, Values, run_frame};

type Bank = Config<64, 8192, 2048>;
/// Other capacities, which change nothing.
type Other = Config<81, 4096, 1024>;

fn image<const M: usize, const P: usize, const B: usize>(config: &Config<M, P, B>) -> Vec<u8> {
    let mut bytes = Vec::new();
    config.save(&mut |piece| bytes.extend_from_slice(piece));
    bytes
}

fn load<const M: usize, const P: usize, const B: usize>(
    config: &mut Config<M, P, B>,
    bytes: &[u8],
) -> Result<(), ImageError> {
    let mut rest = bytes;
    config.load(&mut |out| match rest.split_at_checked(out.len()) {
        Some((piece, after)) => {
            out.copy_from_slice(piece);
            rest = after;
            true
        }
        None => false,
    })
}

/// Everything that can differ between pixels and subapertures does.
fn varied(estimator: Estimator, convention: Convention, rng: &mut Rng) -> Instrument {
    let mut instrument = Instrument::circle(8, 8);
    instrument.estimator = estimator;
    instrument.convention = convention;
    let (count, stroke) = (instrument.count(), instrument.stroke_m);
    let pixels = usize::from(instrument.detector.width) * usize::from(instrument.detector.height);
    let mut each = |low: f64, high: f64, n: usize| -> Vec<f64> {
        (0..n).map(|_| rng.uniform(low, high)).collect()
    };
    instrument.dark_adu = Values::Each(each(80.0, 120.0, pixels));
    instrument.pixel_gain = Values::Each(each(0.5, 2.0, pixels));
    instrument.noise_adu = Values::Each(each(0.5, 3.0, pixels));
    instrument.control_gain = Values::Each(each(0.1, 1.9, count));
    let flats = each(0.4, 0.6, count);
    instrument.flat_m = Values::Each(flats.iter().map(|f| [f * stroke; 3]).collect());
    let tips = each(-1.5, 1.5, count);
    let matrix = |&t: &f64| [[0.5, t, 1.0], [1.0, 1.0, t], [2.0, -t, -1.0]];
    instrument.matrix = Values::Each(tips.iter().map(matrix).collect());
    instrument.slew_m_per_frame = Some(stroke / 50.0);
    instrument.delay_frames = 2;
    instrument.lattice = Some([2, 0, 2]);
    instrument.gate.short_frame = ShortFrame::Drop;
    instrument.safety.valid_min = 0.7;
    instrument.safety.flux_min_adu = 1e4;
    instrument.safety.flux_max_adu = 1e9;
    instrument.safety.saturated_pixels_max = 17;
    instrument.safety.saturated_share = 0.3;
    instrument.serials = Serials { mirror: 0xdead_beef, detector: 4711 };
    instrument
}

const ESTIMATORS: [Estimator; 4] = [
    Estimator::CentreOfGravity,
    Estimator::ThresholdedCentreOfGravity { peak_fraction: 0.1 },
    Estimator::WeightedCentreOfGravity { peak_fraction: 0.1, fwhm_px: 4.0, gain: 1.5 },
    Estimator::Brightest { count: 9 },
];

#[test]
fn a_loaded_image_is_the_saved_configuration() {
    let mut rng = Rng::new(70);
    for (estimator, convention) in
        ESTIMATORS.into_iter().flat_map(|e| [(e, Convention::Subtract), (e, Convention::ZeroBelow)])
    {
        let instrument = varied(estimator, convention, &mut rng);
        let built: Box<Bank> = instrument.config();
        let bytes = image(&built);
        let mut loaded = Box::new(Other::new());
        load(&mut loaded, &bytes).expect("a good image");
        assert!(image(&loaded) == bytes, "what is loaded is saved as the same bytes");
        assert_eq!(loaded.omega(), built.omega());
        assert_eq!(loaded.timing(), built.timing());
        assert_eq!((loaded.range(), loaded.short_frame()), (built.range(), ShortFrame::Drop));
        assert_eq!((loaded.quality(), loaded.ladder()), (built.quality(), built.ladder()));
        assert_eq!(loaded.serials(), Serials { mirror: 0xdead_beef, detector: 4711 });
        assert_eq!((loaded.colours(), loaded.colouring()), (4, built.colouring()));

        let mut expected = Box::new(Pipeline::<64, 2048>::new());
        let mut found = Box::new(Pipeline::<81, 1024>::new());
        for number in 0..4 {
            let spots = scattered(&instrument, (2000, 400, 500), &mut rng);
            let pixels = frame(&instrument, &spots, &Background::DEFAULT, &mut rng);
            let report = run_frame(&mut expected, &built, number, &pixels);
            assert_eq!(run_frame(&mut found, &loaded, number, &pixels), report);
            assert_eq!(found.codes(), expected.codes());
        }
    }
}

/// One wrong bit anywhere, and one byte less anywhere, is found; the configuration is then empty.
#[test]
fn a_damaged_image_is_refused() {
    let mut rng = Rng::new(71);
    let instrument = varied(ESTIMATORS[1], Convention::Subtract, &mut rng);
    let built: Box<Bank> = instrument.config();
    let bytes = image(&built);
    let mut loaded = Box::new(Bank::new());
    // Every byte of the records, and some of the pixels.
    let places = (0..4096).chain((4096..bytes.len()).step_by(61)).chain([bytes.len() - 1]);
    for place in places {
        let mut damaged = bytes.clone();
        damaged[place] ^= 1 << rng.below(8);
        assert!(load(&mut loaded, &damaged).is_err(), "byte {place}");
        assert_eq!(loaded.subapertures(), 0);
    }
    for length in (0..4096).step_by(7).chain([bytes.len() - 1]) {
        let error = load(&mut loaded, &bytes[..length]).expect_err("cut");
        assert_eq!(error, ImageError::Cut, "{length} bytes");
    }
    assert_eq!(load(&mut loaded, b"SIMPLE  = T"), Err(ImageError::NotAnImage));
    let mut newer = bytes.clone();
    newer[4] = 99;
    assert_eq!(load(&mut loaded, &newer), Err(ImageError::Version { found: 99 }));
    load(&mut loaded, &bytes).expect("the image itself");
}

/// Images for a larger board are refused with what does not fit.
#[test]
fn an_image_that_does_not_fit_says_what() {
    let field = |result| match result {
        Err(ImageError::Refused(error)) => error.field,
        other => panic!("{other:?}"),
    };
    let mut instrument = Instrument::circle(8, 8);
    let bytes = image::<64, 8192, 2048>(&instrument.config());
    let small = load(&mut Box::new(Config::<49, 8192, 0>::new()), &bytes);
    assert_eq!(field(small), Field::Across);
    let few_pixels = load(&mut Box::new(Config::<64, 2048, 0>::new()), &bytes);
    assert_eq!(field(few_pixels), Field::WindowPixels);
    instrument.estimator = ESTIMATORS[3];
    let bytes = image::<64, 8192, 2048>(&instrument.config());
    let no_buffer = load(&mut Box::new(Config::<64, 8192, 0>::new()), &bytes);
    assert_eq!(field(no_buffer), Field::BrightestBuffer);
}
