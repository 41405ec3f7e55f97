# Toolchain file: Cortex-M0, run on QEMU's micro:bit (nRF51822).
set(processor -mcpu=cortex-m0)
set(board microbit)
set(linker_script microbit.ld)
set(uart nrf51_uart.c)
set(systick_megahertz 16)
include(${CMAKE_CURRENT_LIST_DIR}/cortex-m.cmake)
