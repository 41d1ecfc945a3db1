"""Which extractor is in use, and how it changes when the model does."""

from juncnet.features import Extractor, Preprocessing


class ExtractorSlot:
    """Holds the extractor in use; a change takes effect only once the new one is ready."""

    def __init__(self, preprocessing: Preprocessing) -> None:
        self.extractor = Extractor(preprocessing)
        self.hash = preprocessing.hash

    def change(self, text: str, expected_hash: str) -> None:
        """Use the preprocessing in `text` (JSON) from now on; nothing happens if it is in use.

        Raises:
            ValueError: `text` is no preprocessing, or not the one with this hash.
        """
        if expected_hash == self.hash:
            return
        preprocessing = Preprocessing.model_validate_json(text)
        if preprocessing.hash != expected_hash:
            raise ValueError(f"its hash is {preprocessing.hash[:8]}, not {expected_hash[:8]}")
        self.extractor = Extractor(preprocessing)
        self.hash = expected_hash
