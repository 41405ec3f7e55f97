# Toolchain file: Cortex-M4 with its single-precision floating-point unit, run on QEMU's MPS2 with
# FPGA image AN386.
set(processor "-mcpu=cortex-m4 -mfloat-abi=hard")
set(board mps2-an386)
set(linker_script mps2.ld)
set(uart mps2_uart.c)
set(systick_megahertz 25)
include(${CMAKE_CURRENT_LIST_DIR}/cortex-m.cmake)
