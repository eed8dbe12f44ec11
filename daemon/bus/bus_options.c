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
        const GVariantType *type = NULL; /* the type that this option must have */
        for (gsize i = 0; i < G_N_ELEMENTS(flags); i++)
            if (strcmp(key, flags[i].key) == 0) {
                type = G_VARIANT_TYPE_BOOLEAN;
                if (g_variant_is_of_type(value, type))
                    *flags[i].flag = g_variant_get_boolean(value);
            }
        for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
            if (strcmp(key, texts[i].key) == 0) {
                type = G_VARIANT_TYPE_STRING;
                if (g_variant_is_of_type(value, type)) {
                    g_free(*texts[i].text);
                    *texts[i].text = g_variant_dup_string(value, NULL);
                }
            }
        if (!type) {
            g_set_error(error, BUS_ERROR, BUS_ERROR_UNKNOWN,
                        "there is no option %s: give process, yes, calibration, chosen, "
                        "session_text or calibration_text",
                        key);
            return FALSE;
        }
        if (!g_variant_is_of_type(value, type)) {
            g_set_error(error, BUS_ERROR, BUS_ERROR_UNKNOWN,
                        "the option %s must be a %s, but its D-Bus type is “%s”", key,
                        g_variant_type_equal(type, G_VARIANT_TYPE_STRING) ? "string" : "boolean",
                        g_variant_get_type_string(value));
            return FALSE;
        }
        g_clear_pointer(&value, g_variant_unref);
    }
    return TRUE;
}
