/* Directs calls of a loaded library to other functions, in the memory of this process; see corrected_calls.py. */
#define _GNU_SOURCE
#include <link.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

struct call {
    const char *name;
    ElfW(Addr) instead; /* address of the function that is called from now on */
};

struct search {
    ElfW(Addr) base; /* of the library */
    const struct call *calls;
    int count;
    int directed; /* places from which it calls */
};

static int direct_place(ElfW(Addr) *place, ElfW(Addr) instead, const ElfW(Phdr) *read_only, ElfW(Addr) base) {
    ElfW(Addr) begin = base + (read_only ? read_only->p_vaddr : 0), end = begin + (read_only ? read_only->p_memsz : 0);
    uintptr_t size = (uintptr_t)sysconf(_SC_PAGESIZE);
    void *page = (void *)((uintptr_t)place & ~(size - 1));
    int protected = (ElfW(Addr))place >= begin && (ElfW(Addr))place < end;
    if (protected && mprotect(page, size, PROT_READ | PROT_WRITE)) return 0;
    __atomic_store_n(place, instead, __ATOMIC_RELEASE);
    if (protected) mprotect(page, size, PROT_READ);
    return 1;
}

/* The tables of a loaded object hold an entry for every place that the dynamic linker fills in with an address. */
static int direct_object(struct dl_phdr_info *object, size_t size, void *data) {
    struct search *search = data;
    const ElfW(Phdr) *read_only = NULL;
    const ElfW(Dyn) *entry = NULL;
    const ElfW(Sym) *symbols = NULL;
    const ElfW(Rela) *tables[2] = {NULL, NULL};
    const char *names = NULL;
    size_t sizes[2] = {0, 0};
    (void)size;
    if (object->dlpi_addr != search->base) return 0;
    for (int i = 0; i < object->dlpi_phnum; i++) {
        if (object->dlpi_phdr[i].p_type == PT_GNU_RELRO) read_only = &object->dlpi_phdr[i];
        if (object->dlpi_phdr[i].p_type == PT_DYNAMIC) entry = (void *)(object->dlpi_addr + object->dlpi_phdr[i].p_vaddr);
    }
    for (; entry && entry->d_tag != DT_NULL; entry++) {
        if (entry->d_tag == DT_SYMTAB) symbols = (void *)entry->d_un.d_ptr;
        if (entry->d_tag == DT_STRTAB) names = (void *)entry->d_un.d_ptr;
        if (entry->d_tag == DT_JMPREL) tables[0] = (void *)entry->d_un.d_ptr;
        if (entry->d_tag == DT_PLTRELSZ) sizes[0] = entry->d_un.d_val;
        if (entry->d_tag == DT_RELA) tables[1] = (void *)entry->d_un.d_ptr;
        if (entry->d_tag == DT_RELASZ) sizes[1] = entry->d_un.d_val;
    }
    for (int i = 0; i < 2 && symbols && names; i++)
        for (size_t j = 0; tables[i] && j < sizes[i] / sizeof(ElfW(Rela)); j++)
            for (int k = 0; k < search->count; k++)
                if (!strcmp(names + symbols[ELF64_R_SYM(tables[i][j].r_info)].st_name, search->calls[k].name))
                    search->directed += direct_place((void *)(object->dlpi_addr + tables[i][j].r_offset),
                                                     search->calls[k].instead, read_only, object->dlpi_addr);
    return 1;
}

static int direct(uintptr_t base, const struct call *calls, int count) {
    struct search search = {base, calls, count, 0};
    dl_iterate_phdr(direct_object, &search);
    return search.directed;
}

/* -- waits: overflowed_wait.py */

/* A time before 1970 is one that has overflowed: the wait was to have no limit. */
static int wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *limit) {
    return limit->tv_sec < 0 ? pthread_cond_wait(condition, mutex) : pthread_cond_timedwait(condition, mutex, limit);
}

/* The number of places that were corrected in the library that is loaded at an address. */
int amb_correct_waits(uintptr_t base) {
    const struct call call = {"pthread_cond_timedwait", (ElfW(Addr))wait_until};
    return direct(base, &call, 1);
}

/* -- arrivals: unnoticed_arrival.py */

typedef int (*set_callback)(void *end_point, void *callback, const void *data);

static set_callback of_client, of_service, of_subscription, of_event;

/* The first call counts what has arrived and then begins to listen; the second counts what came in between. */
static int listen_and_count(set_callback set, void *end_point, void *callback, const void *data) {
    int problem = set(end_point, callback, data);
    return problem || !callback ? problem : set(end_point, callback, data);
}

static int listen_for_answers(void *client, void *callback, const void *data) {
    return listen_and_count(of_client, client, callback, data);
}

static int listen_for_requests(void *service, void *callback, const void *data) {
    return listen_and_count(of_service, service, callback, data);
}

static int listen_for_messages(void *subscription, void *callback, const void *data) {
    return listen_and_count(of_subscription, subscription, callback, data);
}

static int listen_for_events(void *event, void *callback, const void *data) {
    return listen_and_count(of_event, event, callback, data);
}

/* Likewise; the middleware's functions come in the order of the calls. */
int amb_correct_arrivals(uintptr_t base, set_callback client, set_callback service, set_callback subscription,
                         set_callback event) {
    const struct call calls[] = {
        {"rmw_client_set_on_new_response_callback", (ElfW(Addr))listen_for_answers},
        {"rmw_service_set_on_new_request_callback", (ElfW(Addr))listen_for_requests},
        {"rmw_subscription_set_on_new_message_callback", (ElfW(Addr))listen_for_messages},
        {"rmw_event_set_callback", (ElfW(Addr))listen_for_events},
    };
    of_client = client, of_service = service, of_subscription = subscription, of_event = event;
    return direct(base, calls, sizeof calls / sizeof *calls);
}
