//! A plugin of QEMU's code generator: counts the instructions of the emulated processor, exactly,
//! and at every mark appends the total, u64 little-endian, to a file.
//!
//! ```text
//! qemu-system-arm ... -plugin libicount.so,marks=FILE
//! ```
//!
//! A mark is the Thumb hint 0xBFD0. It counts as any other instruction: two in a row are one apart. An
//! instruction that an IT block skips counts as well, since the
//! processor fetches and passes it. For processors with one core.

mod qemu;

use qemu::{Info, PluginId, TranslationBlock};
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::fs::File;
use std::io::Write;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// The hint that marks.
const MARK: [u8; 2] = 0xbfd0_u16.to_le_bytes();

/// Instructions so far. The generated code adds to it without atomics: there is one core, and the
/// thread that emulates it is the one that calls back.
static COUNT: AtomicU64 = AtomicU64::new(0);
static MARKS: OnceLock<File> = OnceLock::new();

/// The version of the interface that this plugin was written for.
#[unsafe(no_mangle)]
pub static qemu_plugin_version: c_int = qemu::VERSION;

/// Called by QEMU when it loads the plugin. Anything but 0 ends QEMU.
///
/// # Safety
/// QEMU gives a valid `info`, and `argc` strings that end with a zero at `argv`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn qemu_plugin_install(
    id: PluginId,
    info: *const Info,
    argc: c_int,
    argv: *const *const c_char,
) -> c_int {
    // SAFETY: as promised by the caller.
    let (versions, arguments) = unsafe { ((*info).version, qemu::arguments(argc, argv)) };
    match install(id, versions, &arguments) {
        Ok(()) => 0,
        Err(error) => {
            eprintln!("icount: {error}");
            1
        }
    }
}

fn install(id: PluginId, versions: qemu::Versions, arguments: &[String]) -> Result<(), String> {
    if !(versions.min..=versions.cur).contains(&qemu::VERSION) {
        return Err(format!(
            "made for version {} of the plugin interface, this QEMU has {} to {}",
            qemu::VERSION,
            versions.min,
            versions.cur
        ));
    }
    let file = match arguments {
        [argument] => argument.strip_prefix("marks="),
        _ => None,
    };
    let file = file.ok_or_else(|| format!("{arguments:?}: must be marks=FILE"))?;
    let marks = File::create(file).map_err(|error| format!("{file}: {error}"))?;
    MARKS.set(marks).map_err(|_| "loaded twice".to_string())?;
    qemu::on_translation(id, translated);
    Ok(())
}

/// QEMU translated a block: has its instructions counted, and its marks reported.
extern "C" fn translated(_: PluginId, block: *mut TranslationBlock) {
    for instruction in qemu::instructions(block) {
        qemu::count(instruction, &COUNT);
        if qemu::is(instruction, MARK) {
            qemu::on_execution(instruction, marked);
        }
    }
}

/// The processor came by a mark.
extern "C" fn marked(_: c_uint, _: *mut c_void) {
    let total = COUNT.load(Ordering::Relaxed).to_le_bytes();
    if MARKS.get().is_some_and(|mut marks| marks.write_all(&total).is_err()) {
        eprintln!("icount: the marks cannot be written");
        std::process::exit(1);
    }
}
