/* The names of onebit_status.h. Constants only. */
#include "onebit_status.h"

#define NAME(code)                                                                                 \
    case code:                                                                                     \
        return #code

const char *onebit_status_name(onebit_status status)
{
    switch (status) {
        NAME(ONEBIT_OK);
        NAME(ONEBIT_NULL);
        NAME(ONEBIT_NOT_STARTED);
        NAME(ONEBIT_STATE);
        NAME(ONEBIT_ESTIMATE);
        NAME(ONEBIT_CLOCK);
        NAME(ONEBIT_MESSAGE);
        NAME(ONEBIT_IDENTIFIER);
        NAME(ONEBIT_CONFIG_FORMAT);
        NAME(ONEBIT_CONFIG_AGENT);
        NAME(ONEBIT_CONFIG_NEIGHBOURS);
        NAME(ONEBIT_CONFIG_STATES);
        NAME(ONEBIT_CONFIG_STABILIZING);
        NAME(ONEBIT_CONFIG_COMPRESSION);
        NAME(ONEBIT_CONFIG_THRESHOLD);
        NAME(ONEBIT_CONFIG_BOUND);
        NAME(ONEBIT_CONFIG_ESTIMATOR_GAIN);
        NAME(ONEBIT_CONFIG_CONTROL_GAIN);
        NAME(ONEBIT_CONFIG_START);
        NAME(ONEBIT_CONFIG_FRACTION_BITS);
        NAME(ONEBIT_CONFIG_FIRST_LINK);
        NAME(ONEBIT_REFUSED_FOREIGN);
        NAME(ONEBIT_REFUSED_LENGTH);
        NAME(ONEBIT_REFUSED_REMOTE);
        NAME(ONEBIT_REFUSED_ERROR_FRAME);
        NAME(ONEBIT_REFUSED_FLEXIBLE);
        NAME(ONEBIT_REFUSED_UNKNOWN);
        NAME(ONEBIT_REFUSED_UNLINKED);
        NAME(ONEBIT_REFUSED_REPEATED);
        NAME(ONEBIT_REFUSED_STALE);
        NAME(ONEBIT_REFUSED_EARLY);
    case ONEBIT_STATUS_COUNT:
        break;
    }
    return "?";
}
