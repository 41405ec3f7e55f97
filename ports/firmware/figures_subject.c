/* The operations of figures_subject.h, in the arithmetic that this file is compiled for. */
#include "figures_subject.h"

#include "onebit_estimator.h"

#include <stddef.h>

void figures_update(const onebit_config *config, const onebit_agent *agent,
                    onebit_estimate *estimate, bool bit)
{
    onebit_update(estimate, &agent->gain, config->threshold, &config->bound, bit);
}

onebit_probability figures_cdf(onebit_real z)
{
    return onebit_distribution(0, z);
}

void figures_step(struct figures_trial *trial)
{
    const onebit_config *config = &trial->config;
    onebit_frame frame;
    onebit_real control;
    trial->config.run = trial->word;
    onebit_send(config, &trial->agent, trial->x, 0, &frame);
    uint8_t step = (uint8_t)(frame.data[0] & 0xFEu);
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        frame.identifier = ONEBIT_PAYLOAD_BASE + config->neighbours[k];
        frame.data[0] = (uint8_t)(step | trial->bits[k]);
        onebit_receive(config, &trial->agent, &frame, ONEBIT_ALL_LINKED, NULL);
    }
    onebit_control(config, &trial->agent, trial->x, ONEBIT_ALL_LINKED, &control);
}
