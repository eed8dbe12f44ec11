/*
 * A request of a client that the server passes on after it has checked the method, the origin and
 * the token (web_tasks.h): its parts, and how it is answered. All functions belong to the main
 * loop's thread.
 */
#pragma once

#include "web_child.h"
#include "web_rig.h"

typedef struct WebSnaps WebSnaps;               /* web_snaps.h */
typedef struct WebProducts WebProducts;         /* web_products.h */
typedef struct WebCalibrations WebCalibrations; /* web_calibrations.h */

/* Receives the answer to a request: an HTTP status, a content type and a body. The callee owns
 * neither type nor body. */
typedef void (*WebTaskAnswer)(guint status, const char *type, GBytes *body, gpointer data);

/* A request. The strings and the query are valid only during the call that begins the task. */
struct web_task {
    WebRig *rig;
    const char *folder;    /* absolute path of the folder of sessions; NULL if there is none */
    WebProducts *products; /* files that were made of sessions */
    WebCalibrations *calibrations;
    WebChild *child;    /* computes one thing at a time */
    WebSnaps *snaps;    /* the last picture on request */
    const char *name;   /* the part of the path that the client chooses; "" if there is none */
    GHashTable *query;  /* char * → char *; NULL if the request has no query */
    WebTaskAnswer back; /* called once, within the call or later */
    gpointer data;
};

/* Answers a task with a text in JSON. */
void web_task_answer(const struct web_task *task, guint status, const char *json);
/* Answers a task with bytes of this content type. The status is 200. */
void web_task_bytes(const struct web_task *task, const char *type, GBytes *bytes);
/* Answers a task with {"error": why}. */
void web_task_refuse(const struct web_task *task, guint status, const char *why);

/* Calls a method of the daemon. The answer of the task is {} or, if to_json is not NULL, the text
 * that to_json() makes of the daemon's answer (g_free()). If the daemon refuses, the answer is 409
 * with its error. parameters may be floating. */
void web_task_call(const struct web_task *task, const char *method, GVariant *parameters,
                   char *(*to_json)(GVariant *answer));

/* Returns the value of a key of the query, or NULL. */
const char *web_task_value(const struct web_task *task, const char *key);
/* Reads a key of the query whose value is 0 or 1. A missing key means 0. For any other value,
 * answers the task with the status 400 and returns FALSE. */
gboolean web_task_flag(const struct web_task *task, const char *key, gboolean *ret);
/* Reads a key of the query whose value is a number from min to max. If the number is missing or out
 * of range, answers the task with the status 400 and returns FALSE. */
gboolean web_task_number(const struct web_task *task, const char *key, double min, double max,
                         double *ret);
