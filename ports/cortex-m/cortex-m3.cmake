# Toolchain file: Cortex-M3, run on QEMU's MPS2 with FPGA image AN385.
set(processor -mcpu=cortex-m3)
set(board mps2-an385)
set(linker_script mps2.ld)
set(uart mps2_uart.c)
set(systick_megahertz 25)
include(${CMAKE_CURRENT_LIST_DIR}/cortex-m.cmake)
