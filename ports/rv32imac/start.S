/*
 * Start-up of an RV32 in machine mode: global and stack pointer, cleared variables, main. Names of
 * memory come from virt.ld, which places this first: the board starts at the begin of its RAM, into
 * which the whole image is loaded, so that initial values are where they belong.
 */
    .section .start, "ax"
    .globl start
start:
    .option push
    .option norelax /* gp cannot be found by way of gp */
    la gp, __global_pointer$
    .option pop
    la sp, stack_top
    la t0, unexpected
    csrw mtvec, t0

    la t0, zeroed_begin
    la t1, zeroed_end
    j 2f
1:  sw zero, 0(t0)
    addi t0, t0, 4
2:  bltu t0, t1, 1b

    call main
    call platform_exit

/* A trap that nobody expects: status 100 and its cause. */
    .balign 4
unexpected:
    csrr a0, mcause
    andi a0, a0, 31
    addi a0, a0, 100
    call platform_exit
