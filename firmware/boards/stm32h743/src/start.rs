//! What must be done before anything runs: code to ITCM, caches, and the regions without one.
#![allow(unsafe_code, reason = "the reset path and the memory protection unit")]

use cortex_m::Peripherals;
use embassy_stm32::pac::RCC;
use stm32h743_logic::mpu;

// Copies the code of ITCM from flash, and zeroes the banks in AXI SRAM. In assembly, since it runs before
// RAM is initialised, and since a compiled loop might become a call of memcpy, which lies in ITCM itself.
core::arch::global_asm!(
    ".section .text.__pre_init, \"ax\"",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "ldr r0, =__sitcm",
    "ldr r1, =__eitcm",
    "ldr r2, =__siitcm",
    "0: cmp r0, r1",
    "beq 1f",
    "ldm r2!, {{r3}}",
    "stm r0!, {{r3}}",
    "b 0b",
    "1: ldr r0, =__sbanks",
    "ldr r1, =__ebanks",
    "movs r3, #0",
    "2: cmp r0, r1",
    "beq 3f",
    "stm r0!, {{r3}}",
    "b 2b",
    "3: dsb",
    "isb",
    "bx lr",
    ".size __pre_init, . - __pre_init",
);

/// Clocks SRAM1 to 3, makes them and the store uncached, and switches the caches on.
pub(crate) fn memories(core: &mut Peripherals) {
    RCC.ahb2enr().modify(|w| {
        w.set_sram1en(true);
        w.set_sram2en(true);
        w.set_sram3en(true);
    });
    const ENABLE_WITH_BACKGROUND: u32 = 0b101;
    // SAFETY: the regions' memory is used by nobody yet; all other memory keeps the default map.
    unsafe {
        for (number, region) in (0..).zip(&mpu::REGIONS) {
            core.MPU.rnr.write(number);
            core.MPU.rbar.write(region.rbar());
            core.MPU.rasr.write(region.rasr());
        }
        core.MPU.ctrl.write(ENABLE_WITH_BACKGROUND);
    }
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
}

/// Whether the watchdog ended the program before this start. It is asked once.
pub(crate) fn by_watchdog() -> bool {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    flags.iwdg1rstf()
}
