#include "errors.h"

#include <arv.h>

#include "drivers/device.h"

static enum device_error code_of(const GError *why) {
    if (why->domain != ARV_DEVICE_ERROR)
        return DEVICE_ERROR_PROTOCOL;
    switch (why->code) {
    case ARV_DEVICE_ERROR_TIMEOUT:
        return DEVICE_ERROR_TIMEOUT;
    case ARV_DEVICE_ERROR_NOT_CONNECTED:
    case ARV_DEVICE_ERROR_TRANSFER_ERROR:
    case ARV_DEVICE_ERROR_NOT_CONTROLLER:
    case ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED:
        return DEVICE_ERROR_DISCONNECTED;
    case ARV_DEVICE_ERROR_FEATURE_NOT_FOUND:
    case ARV_DEVICE_ERROR_WRONG_FEATURE:
        return DEVICE_ERROR_UNSUPPORTED;
    default:
        return DEVICE_ERROR_PROTOCOL;
    }
}

gboolean aravis_error_take(GError *why, const char *what, GError **error) {
    if (!why)
        return TRUE;
    enum device_error code = code_of(why);
    if (code == DEVICE_ERROR_TIMEOUT)
        device_error_set(error, code, NULL,
                         "it does not answer (%s)" ERROR_ADVICE "check its power and cable", what);
    else if (code == DEVICE_ERROR_DISCONNECTED)
        device_error_set(error, code, NULL,
                         "control of the camera was lost (%s: %s)" ERROR_ADVICE
                         "check the cable, and that no other program uses the camera",
                         what, why->message);
    else if (code == DEVICE_ERROR_UNSUPPORTED)
        device_error_set(error, code, NULL,
                         "the camera lacks what the step “%s” needs: %s" ERROR_ADVICE
                         "correct that setting in the camera's section, or use another camera",
                         what, why->message);
    else
        device_error_set(
            error, code, NULL,
            "the step “%s” has failed: %s" ERROR_ADVICE
            "correct that setting in the camera's section, or switch the camera off and on",
            what, why->message);
    g_error_free(why);
    return FALSE;
}

gboolean aravis_error_is_lost(const GError *error) {
    return g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT) ||
           g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
}
