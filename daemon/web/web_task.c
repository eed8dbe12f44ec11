#include "web_task.h"

#include "base/json.h"

#include <libsoup/soup.h>
#include <string.h>

void web_task_answer(const struct web_task *task, guint status, const char *json) {
    g_autoptr(GBytes) bytes = g_bytes_new(json, strlen(json));
    task->back(status, "application/json", bytes, task->data);
}

void web_task_bytes(const struct web_task *task, const char *type, GBytes *bytes) {
    task->back(SOUP_STATUS_OK, type, bytes, task->data);
}

void web_task_refuse(const struct web_task *task, guint status, const char *why) {
    g_autoptr(GString) json = g_string_new("{\"error\": ");
    json_append_string(json, why);
    g_string_append(json, "}\n");
    web_task_answer(task, status, json->str);
}

struct called {
    struct web_task task;
    char *(*to_json)(GVariant *answer);
};

static void on_called(GVariant *answer, const GError *error, gpointer data) {
    g_autofree struct called *called = data;
    if (error) {
        web_task_refuse(&called->task, SOUP_STATUS_CONFLICT, error->message);
        return;
    }
    g_autofree char *json = called->to_json ? called->to_json(answer) : g_strdup("{}\n");
    web_task_answer(&called->task, SOUP_STATUS_OK, json);
}

void web_task_call(const struct web_task *task, const char *method, GVariant *parameters,
                   char *(*to_json)(GVariant *answer)) {
    struct called *called = g_new0(struct called, 1);
    called->task = (struct web_task){.back = task->back, .data = task->data};
    called->to_json = to_json;
    web_rig_call_with(task->rig, method, parameters, on_called, called);
}

const char *web_task_value(const struct web_task *task, const char *key) {
    return task->query ? g_hash_table_lookup(task->query, key) : NULL;
}

gboolean web_task_flag(const struct web_task *task, const char *key, gboolean *ret) {
    const char *value = web_task_value(task, key);
    *ret = value && strcmp(value, "1") == 0;
    if (!value || *ret || strcmp(value, "0") == 0)
        return TRUE;
    g_autofree char *why = g_strdup_printf("%s is neither 0 nor 1 in the query", key);
    web_task_refuse(task, SOUP_STATUS_BAD_REQUEST, why);
    return FALSE;
}

gboolean web_task_number(const struct web_task *task, const char *key, double min, double max,
                         double *ret) {
    const char *value = web_task_value(task, key);
    char *end = NULL;
    *ret = value ? g_ascii_strtod(value, &end) : 0;
    if (value && *value && !g_ascii_isspace(*value) && !*end && *ret >= min && *ret <= max)
        return TRUE;
    g_autofree char *why = g_strdup_printf(
        "the query needs %s, a number from %g to %g, such as ?%s=%g", key, min, max, key, min);
    web_task_refuse(task, SOUP_STATUS_BAD_REQUEST, why);
    return FALSE;
}
