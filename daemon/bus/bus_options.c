#include "bus_options.h"

#include "bus_errors.h"

#include <string.h>

void bus_options_clear(struct bus_options *options) {
    g_free(options->calibration);
    g_free(options->session_text);
    g_free(options->calibration_text);
    g_free(options->exposures);
}

gboolean bus_options_read(GVariant *options, BusOptions *ret, GError **error) {
    const struct {
        const char *key;
        char **text;
    } texts[] = {
        {"calibration", &ret->calibration},
        {"session_text", &ret->session_text},
        {"calibration_text", &ret->calibration_text},
        {"chosen", &ret->exposures},
    };
    const struct {
        const char *key;
        gboolean *flag;
    } flags[] = {{"process", &ret->process}, {"yes", &ret->yes}};
    GVariantIter iter;
    const char *key;
    g_autoptr(GVariant) value = NULL;
    g_variant_iter_init(&iter, options);
    while (g_variant_iter_next(&iter, "{&sv}", &key, &value)) {
        gboolean known = FALSE;
        for (gsize i = 0; i < G_N_ELEMENTS(flags); i++)
            if (strcmp(key, flags[i].key) == 0 &&
                g_variant_is_of_type(value, G_VARIANT_TYPE_BOOLEAN)) {
                *flags[i].flag = g_variant_get_boolean(value);
                known = TRUE;
            }
        for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
            if (strcmp(key, texts[i].key) == 0 &&
                g_variant_is_of_type(value, G_VARIANT_TYPE_STRING)) {
                g_free(*texts[i].text);
                *texts[i].text = g_variant_dup_string(value, NULL);
                known = TRUE;
            }
        if (!known) {
            g_set_error(
                error, BUS_ERROR, BUS_ERROR_UNKNOWN,
                "the option %s does not exist or has the wrong type: give process or yes "
                "(booleans), calibration, chosen, session_text or calibration_text (strings)",
                key);
            return FALSE;
        }
        g_clear_pointer(&value, g_variant_unref);
    }
    return TRUE;
}
