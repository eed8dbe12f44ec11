#include "message.h"

#include "drivers/device.h"

#include <math.h>
#include <string.h>

#define MAX_TEXT 300 /* largest number of bytes of a text that is shown */

#define MAX_EXACT 9007199254740992.0 /* 2⁵³: a double holds every whole number up to it exactly */

static int count_brackets(const char *line, gsize length) {
    int n = 0;
    for (gsize i = 0; i < length; i++)
        n += line[i] == '[' || line[i] == '{';
    return n;
}

/* Returns the start of a text from a program, as one line of valid UTF-8 that can be part of an
 * error message. */
static char *printable(const char *text) {
    g_autofree char *start = g_strndup(text, MAX_TEXT);
    char *valid = g_utf8_make_valid(start, -1);
    for (char *at = valid; *at; at++)
        *at = g_ascii_iscntrl(*at) ? '?' : *at;
    return valid;
}

static JsonNode *member(JsonObject *values, const char *name, GType type) {
    JsonNode *node = json_object_get_member(values, name);
    return node && JSON_NODE_HOLDS_VALUE(node) && json_node_get_value_type(node) == type ? node
                                                                                         : NULL;
}

static JsonObject *object_member(JsonObject *values, const char *name) {
    JsonNode *node = json_object_get_member(values, name);
    return node && JSON_NODE_HOLDS_OBJECT(node) ? json_node_get_object(node) : NULL;
}

char *message_text(JsonObject *values, const char *name) {
    JsonNode *node = member(values, name, G_TYPE_STRING);
    return printable(node ? json_node_get_string(node) : "");
}

/* Fills *ret from the JSON object of a message. */
static gboolean take(JsonObject *object, struct message *ret, GError **error) {
    JsonNode *id = member(object, "id", G_TYPE_INT64);
    const gboolean is_event = !id && member(object, "method", G_TYPE_STRING);
    JsonObject *failure = is_event ? NULL : object_member(object, "error");
    const char *values = id ? "result" : "params";
    if (id && json_node_get_int(id) < 1)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent an answer with the id %" G_GINT64_FORMAT
                                ", but the ids of requests begin at 1",
                                json_node_get_int(id));
    if (!id && !is_event && !failure)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent a message that is neither an answer nor an event");
    if (id && !failure && !json_object_has_member(object, "result"))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent an answer without a result and without an error");
    g_autofree char *version = message_text(object, "jsonrpc");
    *ret = (struct message){.id = id ? (guint64)json_node_get_int(id) : 0,
                            .is_2_0 = g_str_equal(version, "2.0")};
    if (is_event)
        ret->event = message_text(object, "method");
    if (failure) {
        ret->failure = message_text(failure, "message");
        return TRUE;
    }
    JsonObject *given = object_member(object, values);
    ret->values = given ? json_object_ref(given) : json_object_new();
    return TRUE;
}

gboolean message_read(const char *line, gsize length, struct message *ret, GError **error) {
    g_autoptr(JsonParser) parser = json_parser_new_immutable();
    if (length > MESSAGE_MAX)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent a line of more than %d bytes", MESSAGE_MAX);
    if (!g_utf8_validate(line, (gssize)length, NULL))
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent a line that is not UTF-8");
    if (count_brackets(line, length) > MESSAGE_MAX_BRACKETS)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent a line of more than %d arrays and objects",
                                MESSAGE_MAX_BRACKETS);
    if (length == 0 || !json_parser_load_from_data(parser, line, (gssize)length, NULL) ||
        !JSON_NODE_HOLDS_OBJECT(json_parser_get_root(parser))) {
        g_autofree char *start = g_strndup(line, MIN(length, 60));
        g_autofree char *shown = printable(start);
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent a line that is not a JSON object: “%s”", shown);
    }
    return take(json_node_get_object(json_parser_get_root(parser)), ret, error);
}

void message_clear(struct message *message) {
    g_clear_pointer(&message->event, g_free);
    g_clear_pointer(&message->failure, g_free);
    g_clear_pointer(&message->values, json_object_unref);
}

char *message_write(guint64 id, const char *method, gint64 deadline_ms, JsonObject *params) {
    g_autoptr(JsonNode) root = json_node_new(JSON_NODE_OBJECT);
    JsonObject *request = json_object_new();
    JsonObject *with = params ? params : json_object_new();
    json_object_set_string_member(request, "jsonrpc", "2.0");
    json_object_set_int_member(request, "id", (gint64)id);
    json_object_set_string_member(request, "method", method);
    json_object_set_int_member(with, "deadline_ms", deadline_ms);
    json_object_set_object_member(request, "params", with);
    json_node_take_object(root, request);
    g_autofree char *text = json_to_string(root, FALSE);
    return g_strconcat(text, "\n", NULL);
}

gboolean message_number(JsonObject *values, const char *name, double min, double max, double *ret,
                        GError **error) {
    JsonNode *whole = member(values, name, G_TYPE_INT64);
    JsonNode *node = whole ? whole : member(values, name, G_TYPE_DOUBLE);
    if (!node)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent an answer without the number “%s”", name);
    const double value = json_node_get_double(node);
    if (!isfinite(value) || value < min || value > max)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "answered %s = %g, which is out of range: %g to %g", name, value,
                                min, max);
    *ret = value;
    return TRUE;
}

gboolean message_integer(JsonObject *values, const char *name, gint64 min, gint64 max, gint64 *ret,
                         GError **error) {
    double value = 0;
    if (!message_number(values, name, MAX((double)min, -MAX_EXACT), MIN((double)max, MAX_EXACT),
                        &value, error))
        return FALSE;
    *ret = (gint64)value;
    return (double)*ret == value ||
           device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                            "answered %s = %g, which is not a whole number", name, value);
}

static gboolean read_boolean(JsonNode *node, gboolean *ret) {
    if (!node || !JSON_NODE_HOLDS_VALUE(node) || json_node_get_value_type(node) != G_TYPE_BOOLEAN)
        return FALSE;
    *ret = json_node_get_boolean(node);
    return TRUE;
}

gboolean message_boolean(JsonObject *values, const char *name, gboolean *ret, GError **error) {
    return read_boolean(json_object_get_member(values, name), ret) ||
           device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                            "sent an answer in which “%s” is missing or neither true nor false",
                            name);
}

gboolean message_booleans(JsonObject *values, const char *name, int n, gboolean *ret,
                          GError **error) {
    JsonNode *node = json_object_get_member(values, name);
    JsonArray *array = node && JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
    if (!array || json_array_get_length(array) != (guint)n)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent an answer in which “%s” is not an array of %d values", name,
                                n);
    for (guint i = 0; i < (guint)n; i++)
        if (!read_boolean(json_array_get_element(array, i), &ret[i]))
            return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                    "answered a value of “%s” that is neither true nor false",
                                    name);
    return TRUE;
}

gboolean message_integers(JsonObject *values, const char *name, gint64 min, gint64 max,
                          gint64 **ret, int *ret_n, GError **error) {
    JsonNode *node = json_object_get_member(values, name);
    JsonArray *array = node && JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
    const guint n = array ? json_array_get_length(array) : 0;
    g_autofree gint64 *numbers = g_new(gint64, n + 1);
    for (guint i = 0; i < n; i++) {
        JsonNode *element = json_array_get_element(array, i);
        const gboolean is_whole =
            JSON_NODE_HOLDS_VALUE(element) && json_node_get_value_type(element) == G_TYPE_INT64;
        numbers[i] = is_whole ? json_node_get_int(element) : 0;
        if (!is_whole || numbers[i] < min || numbers[i] > max)
            return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                    "answered a value of “%s” that is not a whole number from "
                                    "%" G_GINT64_FORMAT " to %" G_GINT64_FORMAT,
                                    name, min, max);
    }
    if (n == 0)
        return device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                                "sent an answer in which “%s” is not an array of numbers", name);
    *ret = g_steal_pointer(&numbers);
    *ret_n = (int)n;
    return TRUE;
}

gboolean message_has(JsonObject *values, const char *name, const char *text) {
    JsonNode *node = json_object_get_member(values, name);
    JsonArray *array = node && JSON_NODE_HOLDS_ARRAY(node) ? json_node_get_array(node) : NULL;
    for (guint i = 0; array && i < json_array_get_length(array); i++) {
        JsonNode *element = json_array_get_element(array, i);
        if (JSON_NODE_HOLDS_VALUE(element) && json_node_get_value_type(element) == G_TYPE_STRING &&
            g_str_equal(json_node_get_string(element), text))
            return TRUE;
    }
    return FALSE;
}
