"""The papers that the models are from, reproduced: what they print beside what comes out here."""
