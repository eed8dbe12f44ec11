#include "hooks_conf.h"

#include <string.h>

#include "base/nearest.h"

const char *const hooks_events[] = {"begun",        "done",        "fault",  "aborted",   "hands",
                                    "queue-paused", "queue-empty", "unsafe", "confirmed", NULL};
#define EVENTS "done; fault; aborted; hands; queue-paused; queue-empty; unsafe; confirmed"

#define HOOKS(member) G_STRUCT_OFFSET(struct hooks_conf, member)
static const struct option hooks_options[] = {
    {"folder", OPTION_PATH, .fallback = "/etc/mesorig/hooks.d", .offset = HOOKS(folder),
     .help = "Folder of the executables that are run for every event, in the order of their names"},
    {"time_limit_s", OPTION_DOUBLE, "s", 0.1, 86400, "60", .offset = HOOKS(time_limit_s),
     .help = "How long each of them may take before it is ended"},
    {NULL},
};

#define MAIL(member) G_STRUCT_OFFSET(struct hooks_mail, member)
static const struct option mail_options[] = {
    {"to", OPTION_STRINGS, .offset = MAIL(to), .help = "Addresses that get a mail for each event"},
    {"from", OPTION_STRING, .fallback = "mesorig-hooks", .offset = MAIL(from),
     .help = "Address that the mails come from"},
    {"events", OPTION_STRINGS, .fallback = EVENTS, .offset = MAIL(events),
     .help = "Events that a mail is sent for"},
    {"sendmail", OPTION_PATH, .fallback = "/usr/sbin/sendmail", .offset = MAIL(sendmail),
     .help = "Program that sends a mail; most mail servers have one of this name"},
    {NULL},
};

#define WEBHOOK(member) G_STRUCT_OFFSET(struct hooks_webhook, member)
static const struct option webhook_options[] = {
    {"url", OPTION_STRING, .offset = WEBHOOK(url),
     .help = "Address (http or https) that each event is posted to, as JSON"},
    {"events", OPTION_STRINGS, .fallback = EVENTS, .offset = WEBHOOK(events),
     .help = "Events that are posted"},
    {"token_file", OPTION_STRING, .fallback = "", .offset = WEBHOOK(token_file),
     .help = "File whose first line is sent as a bearer token"},
    {"time_limit_s", OPTION_DOUBLE, "s", 0.1, 3600, "20", .offset = WEBHOOK(time_limit_s),
     .help = "How long the server may take to answer"},
    {"retries", OPTION_INT, NULL, 0, 20, "4", .offset = WEBHOOK(retries),
     .help = "How often a post that failed is tried again; others do not wait for it"},
    {"retry_s", OPTION_DOUBLE, "s", 0.1, 3600, "10", .offset = WEBHOOK(retry_s),
     .help = "Time from the failure to the next attempt; it doubles with each further "
             "one, to an hour at most"},
    {NULL},
};

const struct option *hooks_conf_options(const char *class_name) {
    static const struct {
        const char *class_name;
        const struct option *options;
    } tables[] = {{"hooks", hooks_options}, {"mail", mail_options}, {"webhook", webhook_options}};
    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++)
        if (strcmp(class_name, tables[i].class_name) == 0)
            return tables[i].options;
    return NULL;
}

static void webhook_clear(gpointer data) {
    struct hooks_webhook *webhook = data;
    options_clear(webhook_options, webhook);
    g_free(webhook->name);
}

static void check_events(const struct config_section *section, char **events, Mistakes *mistakes) {
    g_autofree char *all = g_strjoinv(", ", (char **)hooks_events);
    for (char **event = events; *event; event++)
        if (!g_strv_contains(hooks_events, *event))
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "events",
                           "there is no event “%s”; choose from: %s", *event, all);
}

static void take_webhook(struct hooks_conf *conf, const struct config_section *section,
                         Mistakes *mistakes) {
    struct hooks_webhook webhook = {0};
    if (!options_read(&(struct option_target){webhook_options, &webhook}, 1, section, NULL,
                      mistakes))
        return;
    webhook.name = g_strdup(section->name ? section->name : "");
    check_events(section, webhook.events, mistakes);
    g_autoptr(GUri) uri = g_uri_parse(webhook.url, G_URI_FLAGS_NONE, NULL);
    const char *scheme = uri ? g_uri_get_scheme(uri) : "";
    if (!uri || (strcmp(scheme, "http") != 0 && strcmp(scheme, "https") != 0))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "url",
                       "“%s” is not an address that begins with http:// or https://", webhook.url);
    if (*webhook.token_file) {
        char *path = config_resolve(section->config, webhook.token_file);
        g_free(webhook.token_file);
        webhook.token_file = path;
    }
    g_array_append_val(conf->webhooks, webhook);
}

static void take_section(struct hooks_conf *conf, const struct config_section *section,
                         Mistakes *mistakes) {
    if (strcmp(section->class_name, "webhook") == 0) {
        take_webhook(conf, section, mistakes);
    } else if (strcmp(section->class_name, "hooks") == 0) {
        options_clear(hooks_options, conf);
        options_read(&(struct option_target){hooks_options, conf}, 1, section, NULL, mistakes);
    } else if (strcmp(section->class_name, "mail") == 0) {
        conf->mails = options_read(&(struct option_target){mail_options, &conf->mail}, 1, section,
                                   NULL, mistakes);
        if (conf->mails)
            check_events(section, conf->mail.events, mistakes);
        for (char **to = conf->mail.to; conf->mails && *to; to++)
            if (**to == '-' || !**to)
                config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "to",
                               "“%s” is not an address to send mail to: write USER or USER@HOST",
                               *to);
    } else {
        config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                       "there is no such section; this file has [hooks] [mail] [webhook NAME]");
    }
}

gboolean hooks_conf_load(struct hooks_conf *conf, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(Config) config = path ? config_load_checked(path, mistakes) : NULL;
    gsize n = 0;
    *conf = (struct hooks_conf){0};
    options_defaults(hooks_options, conf);
    conf->webhooks = g_array_new(FALSE, FALSE, sizeof(struct hooks_webhook));
    g_array_set_clear_func(conf->webhooks, webhook_clear);
    const struct config_section *sections = config ? config_sections(config, &n) : NULL;
    for (gsize i = 0; i < n; i++)
        if (!sections[i].broken)
            take_section(conf, &sections[i], mistakes);
    if (mistakes_report(mistakes, error))
        return TRUE;
    hooks_conf_clear(conf);
    return FALSE;
}

void hooks_conf_clear(struct hooks_conf *conf) {
    options_clear(hooks_options, conf);
    options_clear(mail_options, &conf->mail);
    g_clear_pointer(&conf->webhooks, g_array_unref);
}
