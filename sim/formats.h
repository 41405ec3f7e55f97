/*
 * Fixed-point formats of a scenario's q31 agents, from worst-case ranges. Format with f fraction
 * bits: value = integer / 2^f, 32-bit two's complement.
 */
#ifndef FORMATS_H
#define FORMATS_H

#include "scenario.h"

struct formats {
    int state;            /* fraction bits of the states */
    int control;          /* of the control */
    int stabilizing;      /* of the row K1 */
    int compression;      /* of the row K2 / sigma */
    double state_range;   /* bound of every |x_k| in the closed loop; infinite if there is none */
    double control_range; /* of |u| */
};

/*
 * Chooses the formats: states and control as the file says, or the most fraction bits that leave
 * one bit to spare over the worst-case range. False and *problem when a range does not fit. Costs
 * agents x states^2 x the powers of A + B K1 until its roots have decayed.
 */
bool formats_choose(const struct scenario *scenario, struct formats *formats,
                    struct problem *problem);

#endif
