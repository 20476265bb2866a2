// Sites and their images in the browser's database, and the lifeboat: the newest site, kept here in case the database or
// the app fails. Plain JavaScript, because it must work when the app does not.
"use strict";

const calib = globalThis.calib = { queue: [], unkept: false };

calib.store = (() => {
  const SITES = "sites", IMAGES = "images";
  let opened = null;
  // Last site passed by the app: its record, and the bytes of its images by id.
  const boat = { record: null, images: new Map() };

  const done = (request) => new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
  const finished = (transaction) => new Promise((resolve, reject) => {
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(transaction.error ?? new DOMException("aborted", "AbortError"));
  });

  const database = () => opened ??= new Promise((resolve, reject) => {
    if (!globalThis.indexedDB) return reject(new DOMException("no IndexedDB", "NotSupportedError"));
    const request = indexedDB.open("calib", 1);
    request.onupgradeneeded = () => {
      request.result.createObjectStore(SITES, { keyPath: "id" });
      request.result.createObjectStore(IMAGES);
    };
    request.onsuccess = () => {
      // Another tab with a newer version of this page may change the database.
      request.result.onversionchange = () => { request.result.close(); opened = null; };
      resolve(request.result);
    };
    request.onerror = () => { opened = null; reject(request.error); };
  });
  const range = (id) => IDBKeyRange.bound([id], [id, []]);

  /** Returns all stored sites without their images, newest first. */
  const list = async () => {
    const base = await database();
    const records = await done(base.transaction(SITES).objectStore(SITES).getAll());
    return records.sort((a, b) => b.kept - a.kept);
  };

  /** Stores a site and its new images. The revision detects changes by another tab. */
  const write = async (record, images) => {
    const base = await database();
    const transaction = base.transaction([SITES, IMAGES], "readwrite");
    const end = finished(transaction);
    // An abort is reported by `end`; an awaited request must not report it a second time.
    end.catch(() => {});
    const sites = transaction.objectStore(SITES);
    const known = await done(sites.get(record.id));
    if ((known?.revision ?? 0) !== record.revision) {
      transaction.abort();
      throw new DOMException("changed in another tab", "VersionError");
    }
    const bytes = [...boat.images.values()].reduce((sum, image) => sum + image.bytes.byteLength, record.site.length);
    sites.put({ ...record, bytes, revision: record.revision + 1, kept: Date.now() });
    for (const [name, data] of images) transaction.objectStore(IMAGES).put(data, [record.id, name]);
    await end;
    return record.revision + 1;
  };

  /** Copies the site to the lifeboat, then stores it. `images`: [id, type, name, bytes] of new images. */
  const keep = async (text, images) => {
    const record = JSON.parse(text);
    if (boat.record?.id !== record.id) boat.images.clear();
    boat.record = record;
    for (const [id, type, name, bytes] of images) boat.images.set(id, { type, name, bytes });
    return write(record, images.map(([id, , , bytes]) => [id, bytes]));
  };

  /** Returns a stored site with its images: [record, [[id, bytes]]]. */
  const load = async (id) => {
    const base = await database();
    const transaction = base.transaction([SITES, IMAGES]);
    const [record, keys, values] = await Promise.all([
      done(transaction.objectStore(SITES).get(id)),
      done(transaction.objectStore(IMAGES).getAllKeys(range(id))),
      done(transaction.objectStore(IMAGES).getAll(range(id))),
    ]);
    if (!record) throw new DOMException("the site was removed", "NotFoundError");
    return [record, keys.map((key, i) => [key[1], values[i]])];
  };

  /** Returns images with their types, by id. */
  const typed = (record, entries) => {
    const types = new Map((record.images ?? []).map((image) => [image.id, image.mime]));
    return new Map(entries.map(([id, bytes]) => [id, { type: types.get(id) ?? "", bytes }]));
  };

  /** Loads a site, with the record as text, and copies it to the lifeboat. */
  const open = async (id) => {
    const [record, entries] = await load(id);
    await calib.rest();
    boat.record = record;
    boat.images.clear();
    for (const [own, image] of typed(record, entries)) boat.images.set(own, image);
    return [JSON.stringify(record), entries];
  };

  const remove = async (id) => {
    const base = await database();
    const transaction = base.transaction([SITES, IMAGES], "readwrite");
    transaction.objectStore(SITES).delete(id);
    transaction.objectStore(IMAGES).delete(range(id));
    return finished(transaction);
  };

  const dataUri = (type, bytes) => new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result);
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(new Blob([bytes], { type }));
  });

  /** Downloads a site as one self-contained file; `images` by id: { type, bytes }. */
  const rescue = async (record, images) => {
    const site = JSON.parse(record.site);
    for (const owner of [...(site.cameras ?? []), ...(site.plan ? [site.plan] : [])]) {
      const image = images.get(owner.image);
      if (image) owner.image = await dataUri(image.type, image.bytes);
    }
    download(`${record.name || "site"}.json`, "application/json", JSON.stringify(site, null, 2));
  };

  /** Downloads a stored site. */
  const rescueKept = async (id) => {
    const [record, entries] = await load(id);
    return rescue(record, typed(record, entries));
  };

  const download = (name, type, data) => {
    const url = URL.createObjectURL(new Blob([data], { type }));
    const link = document.createElement("a");
    link.href = url;
    link.download = name;
    document.body.append(link);
    link.click();
    link.remove();
    // The browser has started the download by then.
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
  };

  return { boat, list, keep, open, remove, rescue, rescueKept, download };
})();
