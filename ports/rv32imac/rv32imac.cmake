# Toolchain file: RV32IMAC, run on QEMU's board virt without firmware of its own.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR riscv32)
set(CMAKE_C_COMPILER riscv64-unknown-elf-gcc)
set(CMAKE_ASM_COMPILER riscv64-unknown-elf-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)

# ISA 2.2 still counts the counters among I: Debian's picolibc has no library for rv32imac_zicsr.
set(processor "-march=rv32imac -mabi=ilp32 -misa-spec=2.2")
set(CMAKE_C_FLAGS_INIT
    "${processor} --specs=picolibc.specs -ffunction-sections -fdata-sections")
set(CMAKE_ASM_FLAGS_INIT ${processor})

set(ONEBIT_PLATFORM rv32imac)

# An instruction takes 2^0 ns of the emulated clock; platform.c counts on it.
set(CMAKE_CROSSCOMPILING_EMULATOR
    qemu-system-riscv32 -M virt -bios none -icount shift=0 -display none -serial none -monitor none
    -chardev stdio,id=console -semihosting-config enable=on,target=native,chardev=console -kernel)
