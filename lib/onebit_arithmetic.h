/*
 * The primitives of the arithmetic that is chosen (onebit_types.h), private to the library: what
 * the verbs are written with, under the same names in onebit_floating.h and onebit_fixed.h. The
 * algorithm itself (onebit_estimator.h, onebit_agent.c) is one text over them.
 */
#ifndef ONEBIT_ARITHMETIC_H
#define ONEBIT_ARITHMETIC_H

#include "onebit_types.h"

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#include "onebit_fixed.h"
#else
#include "onebit_floating.h"
#endif

#endif
