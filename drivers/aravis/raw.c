#include "raw.h"

#include "drivers/device.h"
#include "errors.h"

#include <math.h>
#include <string.h>

/* Maximum number of positions of a selector that are tried. */
#define MAX_POSITIONS 64

enum effect { UNSTEADY, SCALED, CURVED, NEIGHBOURS, MIXED, INVENTED, UNEVEN, OTHER, PACKED };

static const char *const effects[] = {
    [UNSTEADY] = "the same light gives different values from frame to frame",
    [SCALED] = "values are multiplied by a factor that may differ from that of the calibration",
    [CURVED] = "values are not proportional to the light",
    [NEIGHBOURS] = "a value depends on the light at neighbouring pixels, so edges and noise are "
                   "not those of the sensor",
    [MIXED] = "a value depends on the light of other colours",
    [INVENTED] = "values of defective pixels are not measured but computed from their neighbours",
    [UNEVEN] = "values are multiplied by factors that differ over the frame",
    [OTHER] = "frames do not show what the sensor sees",
    [PACKED] = "frames are sent in a form that this program cannot read",
};

/*
 * The functions that alter frames. The features of a function are tried in this order until one is
 * neutral, which means that the function has no effect. They are separated by spaces. NAME is a
 * switch: it is neutral if it is false, or is set to a choice such as Off. NAME=VALUE is neutral if
 * the feature has this choice or strength.
 *
 * Names are those of the Standard Features Naming Convention and of the makers' description files.
 * The table does not have:
 * - geometry, and linear and steady functions that belong to the sensor (correction of columns,
 *   clamping to dark pixels), because they may stay on;
 * - functions that alter only the Mono formats of colour cameras (OnBoardColorProcessEnabled),
 *   because the driver uses the Bayer formats of these cameras.
 */
static const struct {
    const char *what;
    enum effect effect;
    const char *features;
} functions[] = {
    {"automatic exposure", UNSTEADY, "ExposureAuto"},
    {"exposure by the length of a pulse", UNSTEADY, "ExposureMode=Timed"},
    {"automatic exposure compensation", UNSTEADY, "pgrExposureCompensationAuto"},
    {"automatic gain", UNSTEADY, "GainAuto"},
    {"automatic black level", UNSTEADY, "BlackLevelAuto BF_AutoLevelAdjust"},
    {"automatic white balance", UNSTEADY, "BalanceWhiteAuto"},
    {"automatic contrast", UNSTEADY, "ContrastAuto"},
    {"white balance", SCALED, "BalanceRatio=1 BalanceRatioAbs=1"},
    {"digital shift", SCALED, "DigitalShift=0"},
    {"gamma", CURVED, "GammaEnable GammaEnabled GammaCorrection Gamma=1"},
    {"lookup table", CURVED, "LUTEnable LUTEnabled"},
    {"contrast", CURVED, "ContrastEnable ContrastMode BslContrast=0"},
    {"brightness", CURVED, "BslBrightness=0"},
    {"high dynamic range", CURVED, "HDREnable HDR_Mode pgrHDRModeEnabled"},
    {"sharpening", NEIGHBOURS,
     "SharpeningEnable SharpnessEnabled ConvolutionMode EdgeFilter SharpeningMode "
     "SharpnessEnhancement=0 SharpnessEnhancementAbs=0 Sharpness=0 Sharpening=0"},
    {"noise reduction", NEIGHBOURS,
     "DenoisingEnable NoiseReductionEnable NoiseReductionMode NoiseReduction=0 "
     "NoiseReductionAbs=0 BslNoiseReduction=0 Denoising=0"},
    {"median filter", NEIGHBOURS, "MedianFilter"},
    {"colour transformation", MIXED,
     "ColorTransformationEnable ColorTransformationMode ColorCorrectionMatrixEnable"},
    {"colour adjustment", MIXED, "ColorAdjustmentEnable"},
    {"colour processing of raw formats", MIXED, "ProcessedRawEnable"},
    {"saturation", MIXED, "SaturationEnable SaturationEnabled BslSaturation=1 Saturation=1"},
    {"hue", MIXED, "HueEnable HueEnabled BslHue=0 Hue=0"},
    {"static defect correction", INVENTED,
     "DefectCorrectStaticEnable DefectMaskEnable DefectMaskPixelEnable "
     "pgrDefectPixelCorrectionEnable BslStaticDefectPixelCorrectionMode DefectPixelCorrection "
     "DefectPixelCorrectionEnable DefectivePixelCorrection VendorDefectPixelCorr"},
    {"defect correction of columns", INVENTED, "DefectMaskColumnEnable"},
    {"dynamic defect correction", INVENTED,
     "DefectCorrectDynamicEnable DynamicDefectivePixelCorrection"},
    {"correction of hot pixels", INVENTED, "HotPixelCorrection HotPixelCorrectionEnable"},
    {"defect and pattern corrections", INVENTED, "CorrectionMode"},
    {"flat-field correction", UNEVEN, "FfcEnable FlatFieldCorrection FlatFieldCorrectionEnable"},
    {"shading correction", UNEVEN,
     "LensShadingCorrectionMode VignettingCorrectionMode ShadingEnable ShadingCorrectionEnable"},
    {"test picture", OTHER, "TestPattern TestPattern=Normal TestImageSelector"},
    {"marks on defects", OTHER, "DefectPixelTestMode pgrDefectPixelCorrectionTestMode"},
    {"compression", PACKED, "ImageCompressionMode"},
};

struct survey {
    ArvGc *gc;
    GPtrArray *features; /* names, of all categories; not owned */
    /* Maps the name of a feature to a GPtrArray of ArvGcEnumeration, not owned. */
    GHashTable *selectors;
    gboolean switch_off;
};

struct visit { /* the state of a feature over all positions of its selectors */
    gboolean available, on;
    /* values at the first position of the selectors where the feature is on; if it is on at none,
     * values at the last position */
    char *position, *value, *why;
};

static void raw_free(struct aravis_raw *raw) {
    g_free(raw->feature);
    g_free(raw->value);
    g_free(raw->why);
    g_free(raw);
}

/* Returns whether an error means that the camera is lost. Any other error is a refusal, for example
 * of a protected register. */
static gboolean lost(const GError *why) {
    return why && why->domain == ARV_DEVICE_ERROR &&
           (why->code == ARV_DEVICE_ERROR_TIMEOUT || why->code == ARV_DEVICE_ERROR_NOT_CONNECTED ||
            why->code == ARV_DEVICE_ERROR_TRANSFER_ERROR ||
            why->code == ARV_DEVICE_ERROR_NOT_CONTROLLER);
}

/* The next functions list the features of all categories, and their selectors. */

static void collect(struct survey *survey, const char *name, GHashTable *seen) {
    ArvGcNode *node = arv_gc_get_node(survey->gc, name);
    if (!node || !g_hash_table_add(seen, node))
        return;
    if (!ARV_IS_GC_CATEGORY(node)) {
        if (ARV_IS_GC_FEATURE_NODE(node))
            g_ptr_array_add(survey->features,
                            (char *)arv_gc_feature_node_get_name(ARV_GC_FEATURE_NODE(node)));
        return;
    }
    for (const GSList *at = arv_gc_category_get_features(ARV_GC_CATEGORY(node)); at; at = at->next)
        collect(survey, at->data, seen);
}

static void survey_begin(struct survey *survey, ArvDevice *device, gboolean switch_off) {
    g_autoptr(GHashTable) seen = g_hash_table_new(NULL, NULL);
    *survey = (struct survey){
        arv_device_get_genicam(device), g_ptr_array_new(),
        g_hash_table_new_full(g_str_hash, g_str_equal, NULL, (GDestroyNotify)g_ptr_array_unref),
        switch_off};
    collect(survey, "Root", seen);
    for (guint i = 0; i < survey->features->len; i++) {
        ArvGcNode *node = arv_gc_get_node(survey->gc, survey->features->pdata[i]);
        if (!ARV_IS_GC_ENUMERATION(node) || !ARV_IS_GC_SELECTOR(node))
            continue;
        const GSList *at = arv_gc_selector_get_selected_features(ARV_GC_SELECTOR(node));
        for (; at; at = at->next) {
            const char *name = arv_gc_feature_node_get_name(at->data);
            GPtrArray *selectors = name ? g_hash_table_lookup(survey->selectors, name) : NULL;
            if (name && !selectors) {
                selectors = g_ptr_array_new();
                g_hash_table_insert(survey->selectors, (char *)name, selectors);
            }
            if (name)
                g_ptr_array_add(selectors, node);
        }
    }
}

static void survey_end(struct survey *survey) {
    g_ptr_array_unref(survey->features);
    g_hash_table_unref(survey->selectors);
}

/* The next functions examine one feature at the present position of its selectors. */

/* Returns whether a choice of a feature means that the feature is off, such as "Off", "OFF",
 * "Disabled", or "ContrastMode_Off" for the feature ContrastMode. */
static gboolean means_off(const char *feature, const char *entry) {
    static const char *const words[] = {"Off", "None", "Disable", "Disabled", "False", "No"};
    gsize n = strlen(feature);
    if (g_ascii_strncasecmp(entry, feature, n) == 0 && entry[n] == '_')
        entry += n + 1;
    for (gsize i = 0; i < G_N_ELEMENTS(words); i++)
        if (g_ascii_strcasecmp(entry, words[i]) == 0)
            return TRUE;
    return FALSE;
}

static gboolean entry_fits(ArvGcFeatureNode *node, const char *neutral, const char *entry) {
    return neutral ? g_strcmp0(entry, neutral) == 0
                   : entry && means_off(arv_gc_feature_node_get_name(node), entry);
}

/* Returns the strength at which the function has no effect, in the unit of the feature. For a
 * feature in percent, a factor of 1 is 100. */
static double neutral_strength(ArvGcFeatureNode *node, const char *neutral) {
    double strength = neutral ? g_ascii_strtod(neutral, NULL) : 0;
    const char *unit = ARV_IS_GC_FLOAT(node) ? arv_gc_float_get_unit(ARV_GC_FLOAT(node)) : NULL;
    gboolean percent = g_strcmp0(unit, "%") == 0 || g_strcmp0(unit, "percent") == 0;
    return percent ? 100 * strength : strength;
}

static gboolean is_neutral(ArvGcFeatureNode *node, const char *neutral, GError **why) {
    if (ARV_IS_GC_ENUMERATION(node))
        return entry_fits(node, neutral,
                          arv_gc_enumeration_get_string_value(ARV_GC_ENUMERATION(node), why));
    if (ARV_IS_GC_BOOLEAN(node))
        return !arv_gc_boolean_get_value(ARV_GC_BOOLEAN(node), why) && !*why;
    double strength = neutral_strength(node, neutral);
    double is = ARV_IS_GC_FLOAT(node) ? arv_gc_float_get_value(ARV_GC_FLOAT(node), why)
                                      : (double)arv_gc_integer_get_value(ARV_GC_INTEGER(node), why);
    return !*why && fabs(is - strength) <= 1e-3 * MAX(fabs(strength), 1);
}

static gboolean set_strength(ArvGcFeatureNode *node, double strength, GError **why) {
    double low, high;
    if (ARV_IS_GC_FLOAT(node)) {
        low = arv_gc_float_get_min(ARV_GC_FLOAT(node), why);
        high = *why ? 0 : arv_gc_float_get_max(ARV_GC_FLOAT(node), why);
    } else {
        low = (double)arv_gc_integer_get_min(ARV_GC_INTEGER(node), why);
        high = *why ? 0 : (double)arv_gc_integer_get_max(ARV_GC_INTEGER(node), why);
    }
    if (*why)
        return FALSE;
    if (strength < low || strength > high) {
        g_set_error(why, DEVICE_ERROR, DEVICE_ERROR_RANGE,
                    "its range, %g to %g, does not contain %g", low, high, strength);
        return FALSE;
    }
    if (ARV_IS_GC_FLOAT(node))
        arv_gc_float_set_value(ARV_GC_FLOAT(node), strength, why);
    else
        arv_gc_integer_set_value(ARV_GC_INTEGER(node), (gint64)strength, why);
    return !*why;
}

/* Writes the value at which the feature has no effect. Returns FALSE and sets why on failure. */
static gboolean neutralise(ArvGcFeatureNode *node, const char *neutral, GError **why) {
    if (arv_gc_feature_node_get_actual_access_mode(node) == ARV_GC_ACCESS_MODE_RO) {
        g_set_error_literal(why, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "it can only be read");
        return FALSE;
    }
    if (ARV_IS_GC_BOOLEAN(node)) {
        arv_gc_boolean_set_value(ARV_GC_BOOLEAN(node), FALSE, why);
        return !*why;
    }
    if (!ARV_IS_GC_ENUMERATION(node))
        return set_strength(node, neutral_strength(node, neutral), why);
    guint n = 0;
    ArvGcEnumeration *choice = ARV_GC_ENUMERATION(node);
    g_autofree const char **entries =
        arv_gc_enumeration_dup_available_string_values(choice, &n, why);
    for (guint i = 0; !*why && i < n; i++)
        if (entry_fits(node, neutral, entries[i]))
            return arv_gc_enumeration_set_string_value(choice, entries[i], why);
    if (!*why)
        g_set_error(why, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED, "it has no choice \"%s\"",
                    neutral ? neutral : "Off");
    return FALSE;
}

static gboolean can_be_used(ArvGcFeatureNode *node, GError **why) {
    return arv_gc_feature_node_is_implemented(node, why) && !*why &&
           arv_gc_feature_node_is_available(node, why) && !*why;
}

/* Examines a feature at the present position of its selectors, and switches it off if
 * survey->switch_off is TRUE. Writes the result to visit. Returns FALSE and sets why if the camera
 * is lost. */
static gboolean visit_one(const struct survey *survey, ArvGcFeatureNode *node, const char *neutral,
                          const char *position, struct visit *visit, GError **why) {
    g_autoptr(GError) refused = NULL, ignored = NULL;
    gboolean usable = can_be_used(node, &ignored);
    gboolean off = usable && is_neutral(node, neutral, &refused);
    if (usable && !off && survey->switch_off && !lost(refused)) {
        g_clear_error(&refused);
        off = neutralise(node, neutral, &refused) && is_neutral(node, neutral, &refused);
    }
    if (lost(refused) || lost(ignored)) {
        g_propagate_error(why, g_error_copy(lost(refused) ? refused : ignored));
        return FALSE;
    }
    if (!usable)
        return TRUE;
    visit->available = TRUE;
    if (visit->on)
        return TRUE;
    g_clear_error(&ignored);
    const char *value = arv_gc_feature_node_get_value_as_string(node, &ignored);
    g_free(visit->position);
    g_free(visit->value);
    visit->position = g_strdup(position);
    visit->value = g_strdup(value ? value : "unreadable");
    visit->on = !off;
    if (!off)
        visit->why = g_strdup(refused              ? refused->message
                              : survey->switch_off ? "it does not keep the value that was set"
                                                   : "it is on");
    return TRUE;
}

/* Visits a feature at all positions of its selectors. from is the first selector that is not set
 * yet. Returns FALSE and sets why if the camera is lost. */
static gboolean raw_visit(const struct survey *survey, ArvGcFeatureNode *node, const char *neutral,
                          guint from, const char *position, struct visit *visit, GError **why) {
    const GPtrArray *selectors =
        g_hash_table_lookup(survey->selectors, arv_gc_feature_node_get_name(node));
    if (!selectors || from >= selectors->len)
        return visit_one(survey, node, neutral, position, visit, why);
    ArvGcEnumeration *selector = selectors->pdata[from];
    g_autoptr(GError) unusable = NULL;
    guint n = 0;
    g_autofree char *stood = NULL;
    g_autofree const char **entries = NULL;
    if (can_be_used(ARV_GC_FEATURE_NODE(selector), &unusable))
        stood = g_strdup(arv_gc_enumeration_get_string_value(selector, &unusable));
    if (stood && !unusable)
        entries = arv_gc_enumeration_dup_available_string_values(selector, &n, &unusable);
    if (!entries || n == 0)
        return raw_visit(survey, node, neutral, from + 1, position, visit, why);
    gboolean answered = TRUE;
    for (guint i = 0; answered && i < MIN(n, MAX_POSITIONS); i++) {
        g_autofree char *at = g_strdup_printf("%s[%s]", position, entries[i]);
        if (arv_gc_enumeration_set_string_value(selector, entries[i], NULL))
            answered = raw_visit(survey, node, neutral, from + 1, at, visit, why);
    }
    if (answered)
        arv_gc_enumeration_set_string_value(selector, stood, NULL);
    return answered;
}

/* Visits the features of function i in order until one is neutral, and appends the function to
 * found if the camera has one of them. Returns FALSE and sets why if the camera is lost. */
static gboolean function(const struct survey *survey, gsize i, GPtrArray *found, GError **why) {
    g_auto(GStrv) names = g_strsplit(functions[i].features, " ", -1);
    struct aravis_raw *raw = NULL;
    gboolean answered = TRUE, off = FALSE;
    for (char **name = names; answered && !off && *name; name++) {
        g_auto(GStrv) parts = g_strsplit(*name, "=", 2);
        ArvGcNode *node = arv_gc_get_node(survey->gc, parts[0]);
        struct visit visit = {0};
        if (!ARV_IS_GC_BOOLEAN(node) && !ARV_IS_GC_ENUMERATION(node) && !ARV_IS_GC_FLOAT(node) &&
            !ARV_IS_GC_INTEGER(node))
            continue;
        answered = raw_visit(survey, ARV_GC_FEATURE_NODE(node), parts[1], 0, parts[0], &visit, why);
        off = visit.available && !visit.on;
        if (off)
            g_clear_pointer(&raw, raw_free);
        if (visit.available && !raw) {
            raw = g_new0(struct aravis_raw, 1);
            *raw = (struct aravis_raw){functions[i].what,
                                       effects[functions[i].effect],
                                       g_steal_pointer(&visit.position),
                                       g_steal_pointer(&visit.value),
                                       g_steal_pointer(&visit.why),
                                       functions[i].effect == UNSTEADY};
        }
        g_free(visit.position);
        g_free(visit.value);
        g_free(visit.why);
    }
    if (raw)
        g_ptr_array_add(found, raw);
    return answered;
}

GPtrArray *aravis_raw_survey(ArvDevice *device, gboolean switch_off, GError **error) {
    g_autoptr(GPtrArray) found = g_ptr_array_new_with_free_func((GDestroyNotify)raw_free);
    struct survey survey;
    GError *why = NULL;
    survey_begin(&survey, device, switch_off);
    gboolean answered = TRUE;
    for (gsize i = 0; answered && i < G_N_ELEMENTS(functions); i++)
        answered = function(&survey, i, found, &why);
    survey_end(&survey);
    return aravis_error_take(why, "switching off what alters frames", error)
               ? g_steal_pointer(&found)
               : NULL;
}

/* The next functions find features that the table lacks. */

static gboolean in_table(const char *feature) {
    gsize n = strlen(feature);
    for (gsize i = 0; i < G_N_ELEMENTS(functions); i++)
        for (const char *at = functions[i].features; *at; at += strcspn(at, " "), at += *at == ' ')
            if (strncmp(at, feature, n) == 0 && strchr("= ", at[n]))
                return TRUE;
    return FALSE;
}

static gboolean sounds_altering(const char *feature) {
    static const char *const words[] = {
        "gamma",   "lut",      "sharp",   "noise",    "nois",    "defect", "hotpix", "median",
        "shading", "vignet",   "flatfi",  "ffc",      "prnu",    "hdr",    "satura", "hue",
        "contras", "colortra", "correct", "processe", "enhance", "compres"};
    if (g_str_has_prefix(feature, "LogicBlock") || g_str_has_suffix(feature, "Selector"))
        return FALSE; /* logic blocks belong to input lines; a selector itself has no effect */
    g_autofree char *low = g_ascii_strdown(feature, -1);
    for (gsize i = 0; i < G_N_ELEMENTS(words); i++)
        if (strstr(low, words[i]))
            return TRUE;
    return FALSE;
}

char **aravis_raw_unknown(ArvDevice *device) {
    GPtrArray *list = g_ptr_array_new();
    struct survey survey;
    survey_begin(&survey, device, FALSE);
    for (guint i = 0; i < survey.features->len; i++) {
        const char *name = survey.features->pdata[i];
        ArvGcNode *node = arv_gc_get_node(survey.gc, name);
        g_autoptr(GError) why = NULL;
        gboolean is_switch = ARV_IS_GC_BOOLEAN(node) ||
                             (ARV_IS_GC_ENUMERATION(node) &&
                              !arv_gc_selector_get_selected_features(ARV_GC_SELECTOR(node)));
        if (!is_switch || in_table(name) || !sounds_altering(name))
            continue;
        ArvGcFeatureNode *feature = ARV_GC_FEATURE_NODE(node);
        if (!can_be_used(feature, &why) || is_neutral(feature, NULL, &why) || why ||
            arv_gc_feature_node_get_actual_access_mode(feature) == ARV_GC_ACCESS_MODE_RO)
            continue;
        const char *value = arv_gc_feature_node_get_value_as_string(feature, NULL);
        g_ptr_array_add(list, g_strdup_printf("%s = %s", name, value ? value : "?"));
    }
    survey_end(&survey);
    g_ptr_array_add(list, NULL);
    return (char **)g_ptr_array_free(list, FALSE);
}
