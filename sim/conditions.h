/* The theorems' conditions (paper, Theorems 1-4) that a scenario does or does not meet. */
#ifndef CONDITIONS_H
#define CONDITIONS_H

#include "scenario.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

struct conditions {
    double lambda_2;       /* of the Laplacian weighted by the stationary law; 0 if not connected */
    double lambda_G;       /* ||J W||^2 */
    double lambda_QW;      /* ||Q W||^2 */
    double lambda_QL;      /* ||Q L T||^2 */
    double alpha;          /* 2 sqrt(lambda_QW) + lambda_QL lambda_2 / lambda_G */
    double f_M;            /* density of the noise at |c| + M */
    double pi_min;         /* smallest entry of the stationary law */
    double beta_consensus; /* beta above this: consensus; infinite if not connected */
    double beta_rate;      /* beta above this, gamma > 1/lambda_2: rate 1/t; infinite else */
    double t0_min;         /* t0 must exceed this */
    uint32_t d_max;        /* largest degree in any one graph */
};

/* Largest group whose eigenvalues are computed (dense, cubic cost). */
#define CONDITIONS_AGENTS_MAX 1000u

/* All figures; false when the group is above CONDITIONS_AGENTS_MAX or memory is short. */
bool conditions_compute(const struct scenario *scenario, struct conditions *conditions);

/*
 * One line on `stream`, `warning: key: ...`, for each condition of the theorems that the scenario
 * does not meet: by how much, and what would mend it. Also where a plant error would outlast the
 * run's gain (README, Limits), and where the conditions could not be computed.
 */
void conditions_warn(const struct scenario *scenario, FILE *stream);

#endif
