/*
 * Chooses the arithmetic of a translation unit and maps the library's names to it, so that f64, f32
 * and q31 can live in one program: with ONEBIT_ARITHMETIC=ONEBIT_Q31, the default, onebit_control
 * links as onebit_q31_control. The algorithm itself (onebit_estimator.h, onebit_agent.c) is one
 * text over the primitives of onebit_floating.h or onebit_fixed.h, which have the same names.
 */
#ifndef ONEBIT_ARITHMETIC_H
#define ONEBIT_ARITHMETIC_H

#define ONEBIT_F64 64 /* double, erfc of libm: the reference */
#define ONEBIT_F32 32 /* float, CDF by table; needs no libm */
#define ONEBIT_Q31 31 /* 32-bit fixed point; the same bits on every processor */

#ifndef ONEBIT_ARITHMETIC
#define ONEBIT_ARITHMETIC ONEBIT_Q31
#endif

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#define ONEBIT_NAME(name) onebit_f64_##name
#elif ONEBIT_ARITHMETIC == ONEBIT_F32
#define ONEBIT_NAME(name) onebit_f32_##name
#elif ONEBIT_ARITHMETIC == ONEBIT_Q31
#define ONEBIT_NAME(name) onebit_q31_##name
#else
#error "ONEBIT_ARITHMETIC must be ONEBIT_F64, ONEBIT_F32 or ONEBIT_Q31"
#endif

#define onebit_agent ONEBIT_NAME(agent)
#define onebit_config ONEBIT_NAME(config)
#define onebit_link ONEBIT_NAME(link)

#define onebit_check ONEBIT_NAME(check)
#define onebit_start ONEBIT_NAME(start)
#define onebit_encode ONEBIT_NAME(encode)
#define onebit_receive ONEBIT_NAME(receive)
#define onebit_receive_message ONEBIT_NAME(receive_message)
#define onebit_control ONEBIT_NAME(control)
#define onebit_advance ONEBIT_NAME(advance)

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#include "onebit_fixed.h"
#else
#include "onebit_floating.h"
#endif

#endif
