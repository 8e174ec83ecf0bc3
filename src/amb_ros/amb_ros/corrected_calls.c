/* Corrects waits without a time limit in a library whose time limit overflows; see overflowed_wait.py. */
#define _GNU_SOURCE
#include <link.h>
#include <pthread.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define CALL "pthread_cond_timedwait"

struct search {
    ElfW(Addr) base; /* of the library */
    int corrected;   /* places from which it calls */
};

/* A time before 1970 is one that has overflowed: the wait was to have no limit. */
static int wait_until(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *limit) {
    return limit->tv_sec < 0 ? pthread_cond_wait(condition, mutex) : pthread_cond_timedwait(condition, mutex, limit);
}

static int correct_place(ElfW(Addr) *place, const ElfW(Phdr) *read_only, ElfW(Addr) base) {
    ElfW(Addr) begin = base + (read_only ? read_only->p_vaddr : 0), end = begin + (read_only ? read_only->p_memsz : 0);
    uintptr_t size = (uintptr_t)sysconf(_SC_PAGESIZE);
    void *page = (void *)((uintptr_t)place & ~(size - 1));
    int protected = (ElfW(Addr))place >= begin && (ElfW(Addr))place < end;
    if (protected && mprotect(page, size, PROT_READ | PROT_WRITE)) return 0;
    __atomic_store_n(place, (ElfW(Addr))wait_until, __ATOMIC_RELEASE);
    if (protected) mprotect(page, size, PROT_READ);
    return 1;
}

/* The tables of a loaded object hold an entry for every place that the dynamic linker fills in with an address. */
static int correct_object(struct dl_phdr_info *object, size_t size, void *data) {
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
            if (!strcmp(names + symbols[ELF64_R_SYM(tables[i][j].r_info)].st_name, CALL))
                search->corrected += correct_place((void *)(object->dlpi_addr + tables[i][j].r_offset), read_only, object->dlpi_addr);
    return 1;
}

/* The number of places that were corrected in the library that is loaded at an address. */
int amb_correct_waits(uintptr_t base) {
    struct search search = {base, 0};
    dl_iterate_phdr(correct_object, &search);
    return search.corrected;
}
