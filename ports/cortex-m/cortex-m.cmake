# What the toolchain files of the Cortex-M have in common: GCC with picolibc, start-up and linker
# scripts of this folder, QEMU. Each sets before it includes this:
#   processor          flags that choose the processor
#   board              machine of qemu-system-arm
#   linker_script      of the board
#   uart               source that fills in uart.h on the board
#   systick_megahertz  its processor's clock, for platform.c
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

set(CMAKE_C_FLAGS_INIT
    "${processor} --specs=picolibc.specs -ffunction-sections -fdata-sections")

set(ONEBIT_PLATFORM cortex-m)
set(ONEBIT_LINKER_SCRIPT ${linker_script})
set(ONEBIT_UART ${uart})
set(ONEBIT_SYSTICK_MEGAHERTZ ${systick_megahertz})

# An instruction takes 2^10 ns of the emulated clock; platform.c counts on it.
set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-system-arm -M ${board} -icount shift=10 -display none -serial none -monitor none
    -chardev stdio,id=console -semihosting-config enable=on,target=native,chardev=console -kernel)
