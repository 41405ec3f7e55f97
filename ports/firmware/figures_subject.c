/* The operations of figures_subject.h, in the arithmetic that this file is compiled for. */
#include "figures_subject.h"

#include "onebit_estimator.h"
#include "onebit_random.h"

void figures_update(const onebit_config *config, const onebit_agent *agent, onebit_link *link,
                    bool bit)
{
    onebit_estimate(link, agent->gain, config->threshold, config->bound, bit);
}

onebit_probability figures_cdf(onebit_real u)
{
    return onebit_distribution(u);
}

void figures_step(struct figures_trial *trial)
{
    const onebit_config *config = &trial->config;
    onebit_message message = {.sender = config->agent};
    onebit_frame frame;
    onebit_real control;
    message.step = (uint8_t)(trial->agent.clock % ONEBIT_STEP_MODULUS);
    onebit_encode(config, trial->x,
                  onebit_random_word(1, 0, config->agent, trial->agent.clock ^ trial->word),
                  &message.bit);
    onebit_frame_encode(&config->format, &message, &frame);
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        frame.identifier = ONEBIT_PAYLOAD_BASE + config->neighbours[k];
        frame.data[0] = (uint8_t)(message.step << 1 | trial->bits[k]);
        onebit_receive(config, &trial->agent, &frame);
    }
    onebit_control(config, &trial->agent, trial->x, &control);
}
