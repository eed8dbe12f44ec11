#include "bus_authority.h"

#include "bus_errors.h"

#include <polkit/polkit.h>
#include <string.h>
#include <unistd.h>

#define ACTION(name) "org.mesorig.rig." name

/* Maximum number of calls of all clients about which polkit is being asked. */
#define MAX_QUESTIONS 64

/* Time in seconds to wait for polkit's answer. It is INTERACTION_S if polkit may show a dialog in
 * which the user types a password, otherwise ANSWER_S. */
#define ANSWER_S      25
#define INTERACTION_S 120

/* The methods of etc/org.mesorig.Rig1.xml. acts is TRUE if a method gives light, moves an axis or
 * begins a session. Such a method is refused while the safe state is latched (bus_latch.h). */
static const struct {
    const char *method, *action;
    gboolean acts;
} methods[] = {
    {"OpenRig", ACTION("administer"), FALSE},
    {"CloseRig", ACTION("administer"), FALSE},
    {"Validate", ACTION("look"), FALSE},
    {"GetThumbnail", ACTION("look"), FALSE},
    {"BeginRecording", ACTION("administer"), FALSE},
    {"EndRecording", ACTION("administer"), FALSE},
    {"Snap", ACTION("look"), FALSE},
    {"Start", ACTION("capture"), TRUE}, /* with another calibration, the action is "calibrate" */
    {"Resume", ACTION("capture"), TRUE},
    {"Pause", ACTION("capture"), FALSE},
    {"Continue", ACTION("capture"), TRUE},
    {"Finish", ACTION("capture"), FALSE},
    {"Abort", ACTION("capture"), FALSE},
    {"QueueAdd", ACTION("capture"), TRUE}, /* with another calibration, the action is "calibrate" */
    {"QueueRemove", ACTION("capture"), FALSE},
    {"QueueMove", ACTION("capture"), FALSE},
    {"QueuePause", ACTION("capture"), FALSE},
    {"QueueResume", ACTION("capture"), TRUE},
    /* Switching a lamp off is always allowed, and polkit is not asked. */
    {"SetLamp", ACTION("move"), TRUE},
    {"MoveAxis", ACTION("move"), TRUE},
    {"HomeAxis", ACTION("move"), TRUE},
    {"SetLaser", ACTION("laser"), TRUE}, /* switching off is always allowed, as for SetLamp */
    {"Renew", NULL, TRUE}, /* polkit was asked when the client switched the light on */
    {"Release", ACTION("release"), FALSE},
    {"SafeState", NULL, FALSE},
};

struct question {
    /* NULL if the question was stopped; its call has then been answered */
    struct bus_authority *authority;
    GDBusMethodInvocation *invocation;
    const char *action;
    GCancellable *cancellable;
    guint deadline;
};

const char *bus_authority_action(const char *method, gboolean *ret_known) {
    for (gsize i = 0; i < G_N_ELEMENTS(methods); i++)
        if (strcmp(methods[i].method, method) == 0) {
            if (ret_known)
                *ret_known = TRUE;
            return methods[i].action;
        }
    if (ret_known)
        *ret_known = FALSE;
    return NULL;
}

/* Returns whether a call only switches a light off. Such a call is always allowed. It must not wait
 * for an answer of polkit, because polkit may hang. */
static gboolean only_switches_off(GDBusMethodInvocation *invocation) {
    const char *method = g_dbus_method_invocation_get_method_name(invocation);
    gboolean on = TRUE;
    if (strcmp(method, "SetLaser") == 0 || strcmp(method, "SetLamp") == 0)
        g_variant_get(g_dbus_method_invocation_get_parameters(invocation), "(&sbd)", NULL, &on,
                      NULL);
    return !on;
}

/* If the safe state forbids a call, answers the call with an error and returns TRUE. Otherwise
 * returns FALSE. */
static gboolean refuse_latched(struct bus_authority *authority, GDBusMethodInvocation *invocation) {
    const char *method = g_dbus_method_invocation_get_method_name(invocation);
    GError *error = NULL;
    gsize i = 0;
    while (i < G_N_ELEMENTS(methods) && strcmp(methods[i].method, method) != 0)
        i++;
    if (i == G_N_ELEMENTS(methods) || !methods[i].acts || only_switches_off(invocation) ||
        bus_latch_allows(authority->latch, invocation, &error))
        return FALSE;
    g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
    return TRUE;
}

static const char *action_of(GDBusMethodInvocation *invocation) {
    const char *method = g_dbus_method_invocation_get_method_name(invocation);
    if (strcmp(method, "Start") == 0 || strcmp(method, "QueueAdd") == 0) {
        GVariant *parameters = g_dbus_method_invocation_get_parameters(invocation);
        g_autoptr(GVariant) options = g_variant_get_child_value(parameters, 2);
        g_autoptr(GVariant) calibration = g_variant_lookup_value(options, "calibration", NULL);
        if (calibration)
            return ACTION("calibrate");
    }
    return bus_authority_action(method, NULL);
}

const struct bus_caller *bus_authority_caller(GDBusMethodInvocation *invocation) {
    return g_object_get_data(G_OBJECT(invocation), "caller");
}

/* Passes a call to its handler in bus_calls.c, in the same way as the code that gdbus-codegen has
 * made. */
static GDBusInterfaceVTable *codegen_vtable(BusRig1 *object);
static void pass_on(GDBusMethodInvocation *invocation) {
    BusRig1 *object = g_dbus_method_invocation_get_user_data(invocation);
    codegen_vtable(object)->method_call(g_dbus_method_invocation_get_connection(invocation),
                                        g_dbus_method_invocation_get_sender(invocation),
                                        g_dbus_method_invocation_get_object_path(invocation),
                                        g_dbus_method_invocation_get_interface_name(invocation),
                                        g_dbus_method_invocation_get_method_name(invocation),
                                        g_dbus_method_invocation_get_parameters(invocation),
                                        invocation, object);
}

/* Answers the call of a question with an error. Takes ownership of the error. */
static void question_refuse(struct question *question, GError *error) {
    g_dbus_method_invocation_take_error(g_steal_pointer(&question->invocation),
                                        bus_errors_wrap(error));
}

static void question_stop(struct bus_authority *authority, struct question *question,
                          GError *error) {
    g_ptr_array_remove(authority->questions, question);
    question->authority = NULL;
    question_refuse(question, error);
    g_cancellable_cancel(question->cancellable);
}

gboolean bus_authority_stop(struct bus_authority *authority, const char *why) {
    gboolean begins = FALSE;
    while (authority->questions->len > 0) {
        struct question *question = authority->questions->pdata[0];
        const char *method = g_dbus_method_invocation_get_method_name(question->invocation);
        begins |= strcmp(method, "Start") == 0 || strcmp(method, "Resume") == 0;
        question_stop(authority, question,
                      g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED, why));
    }
    return begins;
}

static gboolean question_late(gpointer data) {
    struct question *question = data;
    question->deadline = 0;
    question_stop(question->authority, question,
                  g_error_new(BUS_ERROR, BUS_ERROR_DENIED,
                              "polkit has not answered in time whether you may call %s (action "
                              "%s): try again; if that does not help, see systemctl status polkit",
                              g_dbus_method_invocation_get_method_name(question->invocation),
                              question->action));
    return G_SOURCE_REMOVE;
}

/* Ends a question and frees it. Takes ownership of error. The call is then handled as follows:
 * - If allowed is TRUE, the call is passed on. If the safe state was latched meanwhile, the call is
 *   refused instead.
 * - If allowed is FALSE, the call is answered with error.
 * - If the question was stopped, nothing is done, because the call has been answered. */
static void question_end(struct question *question, gboolean allowed, GError *error) {
    if (question->authority) {
        g_ptr_array_remove(question->authority->questions, question);
        if (!allowed)
            question_refuse(question, g_steal_pointer(&error));
        else if (!refuse_latched(question->authority, question->invocation))
            pass_on(question->invocation);
    }
    g_clear_error(&error);
    g_clear_handle_id(&question->deadline, g_source_remove);
    g_object_unref(question->cancellable);
    g_free(question);
}

static void on_answer(GObject *source, GAsyncResult *result, gpointer data) {
    struct question *question = data;
    GError *error = NULL;
    g_autoptr(PolkitAuthorizationResult) answer =
        polkit_authority_check_authorization_finish(POLKIT_AUTHORITY(source), result, &error);
    if (g_error_matches(error, G_DBUS_ERROR, G_DBUS_ERROR_SERVICE_UNKNOWN)) {
        g_clear_error(&error);
        question_end(question, TRUE, NULL); /* polkit is not installed */
        return;
    }
    const gboolean allowed = answer && polkit_authorization_result_get_is_authorized(answer);
    /* If the question was stopped, its call has been answered. */
    if (!question->authority) {
        question_end(question, FALSE, error);
        return;
    }
    if (answer && !allowed)
        error = g_error_new(BUS_ERROR, BUS_ERROR_DENIED,
                            "you are not allowed to call %s: an administrator can allow the action "
                            "%s in /etc/polkit-1/rules.d; “mesorig safe” is always allowed",
                            g_dbus_method_invocation_get_method_name(question->invocation),
                            question->action);
    else if (!answer)
        g_prefix_error(&error,
                       "polkit cannot be asked whether you may call %s (action %s); see systemctl "
                       "status polkit: ",
                       g_dbus_method_invocation_get_method_name(question->invocation),
                       question->action);
    question_end(question, allowed, error);
}

static void on_authority(GObject *source, GAsyncResult *result, gpointer data) {
    struct question *question = data;
    GError *error = NULL;
    g_autoptr(PolkitAuthority) authority = polkit_authority_get_finish(result, &error);
    if (!authority || !question->authority) {
        question_end(question, FALSE, error);
        return;
    }
    GDBusMessage *message = g_dbus_method_invocation_get_message(question->invocation);
    const gboolean interactive =
        g_dbus_message_get_flags(message) & G_DBUS_MESSAGE_FLAGS_ALLOW_INTERACTIVE_AUTHORIZATION;
    g_autoptr(PolkitSubject) subject =
        polkit_system_bus_name_new(g_dbus_method_invocation_get_sender(question->invocation));
    question->deadline =
        g_timeout_add_seconds(interactive ? INTERACTION_S : ANSWER_S, question_late, question);
    polkit_authority_check_authorization(
        authority, subject, question->action, NULL,
        interactive ? POLKIT_CHECK_AUTHORIZATION_FLAGS_ALLOW_USER_INTERACTION
                    : POLKIT_CHECK_AUTHORIZATION_FLAGS_NONE,
        question->cancellable, on_answer, question);
}

static void read_caller(GVariant *credentials, struct bus_caller *ret) {
    g_autoptr(GVariant) groups =
        g_variant_lookup_value(credentials, "UnixGroupIDs", G_VARIANT_TYPE("au"));
    gsize n = 0;
    const guint32 *ids = groups ? g_variant_get_fixed_array(groups, &n, sizeof *ids) : NULL;
    ret->n_groups = (int)MIN(n, BUS_CALLER_GROUPS);
    for (int i = 0; i < ret->n_groups; i++)
        ret->groups[i] = ids[i];
}

static void on_credentials(GObject *source, GAsyncResult *result, gpointer data) {
    struct question *question = data;
    g_autofree struct bus_caller *caller = g_new0(struct bus_caller, 1);
    GError *error = NULL;
    g_autoptr(GVariant) answer =
        g_dbus_connection_call_finish(G_DBUS_CONNECTION(source), result, &error);
    g_autoptr(GVariant) credentials = answer ? g_variant_get_child_value(answer, 0) : NULL;
    if (credentials && !g_variant_lookup(credentials, "UnixUserID", "u", &caller->uid))
        g_set_error_literal(
            &error, BUS_ERROR, BUS_ERROR_DENIED,
            "the message bus does not know which user has made this call, so polkit cannot be "
            "asked whether the call is allowed: call from a program of a user of this computer");
    if (error || !question->authority) {
        question_end(question, FALSE, error);
        return;
    }
    read_caller(credentials, caller);
    if (caller->uid != 0 && caller->uid != getuid())
        g_object_set_data_full(G_OBJECT(question->invocation), "caller", g_steal_pointer(&caller),
                               g_free);
    polkit_authority_get_async(question->cancellable, on_authority, question);
}

static void ask(struct bus_authority *authority, GDBusMethodInvocation *invocation) {
    struct question *question = g_new0(struct question, 1);
    *question =
        (struct question){authority, invocation, action_of(invocation), g_cancellable_new(), 0};
    g_ptr_array_add(authority->questions, question);
    g_dbus_connection_call(g_dbus_method_invocation_get_connection(invocation),
                           "org.freedesktop.DBus", "/org/freedesktop/DBus", "org.freedesktop.DBus",
                           "GetConnectionCredentials",
                           g_variant_new("(s)", g_dbus_method_invocation_get_sender(invocation)),
                           G_VARIANT_TYPE("(a{sv})"), G_DBUS_CALL_FLAGS_NONE, ANSWER_S * 1000,
                           question->cancellable, on_credentials, question);
}

static void authority_method_call(GDBusConnection *connection, const char *sender, const char *path,
                                  const char *interface, const char *method, GVariant *parameters,
                                  GDBusMethodInvocation *invocation, gpointer object) {
    struct bus_authority *authority = g_object_get_data(object, "authority");
    if (authority && refuse_latched(authority, invocation))
        return;
    if (!authority || !authority->asks || !sender || !bus_authority_action(method, NULL) ||
        only_switches_off(invocation))
        pass_on(invocation);
    else if (authority->questions->len >= MAX_QUESTIONS)
        g_dbus_method_invocation_return_error(invocation, BUS_ERROR, BUS_ERROR_LIMIT,
                                              "%d calls of all clients wait for polkit's answer, "
                                              "which is the maximum: try again later",
                                              MAX_QUESTIONS);
    else
        ask(authority, invocation);
}

typedef BusRig1Skeleton AuthoritySkeleton;
typedef BusRig1SkeletonClass AuthoritySkeletonClass;
static GType authority_skeleton_get_type(void);
G_DEFINE_TYPE(AuthoritySkeleton, authority_skeleton, BUS_TYPE_RIG1_SKELETON)

static GDBusInterfaceVTable *codegen_vtable(BusRig1 *object) {
    return G_DBUS_INTERFACE_SKELETON_CLASS(authority_skeleton_parent_class)
        ->get_vtable(G_DBUS_INTERFACE_SKELETON(object));
}

static GDBusInterfaceVTable *authority_get_vtable(GDBusInterfaceSkeleton *skeleton) {
    static GDBusInterfaceVTable vtable;
    vtable = *codegen_vtable(BUS_RIG1(skeleton));
    vtable.method_call = authority_method_call;
    return &vtable;
}

static void authority_skeleton_class_init(AuthoritySkeletonClass *class) {
    G_DBUS_INTERFACE_SKELETON_CLASS(class)->get_vtable = authority_get_vtable;
}

static void authority_skeleton_init(AuthoritySkeleton *skeleton) {
}

BusRig1 *bus_authority_skeleton(void) {
    return g_object_new(authority_skeleton_get_type(), NULL);
}

void bus_authority_attach(BusRig1 *skeleton, struct bus_authority *authority) {
    g_object_set_data(G_OBJECT(skeleton), "authority", authority);
}

void bus_authority_init(struct bus_authority *authority, struct bus_latch *latch,
                        const char *address) {
    authority->questions = g_ptr_array_new();
    authority->latch = latch;
    authority->asks = strcmp(address, "system") == 0;
}

void bus_authority_clear(struct bus_authority *authority) {
    g_ptr_array_unref(authority->questions);
}
